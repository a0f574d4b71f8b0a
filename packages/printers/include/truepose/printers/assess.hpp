// Assessment of a printer: fits, estimate, held-out errors, and conclusions in words.
#pragma once

#include "truepose/printers/bed.hpp"
#include "truepose/printers/gcode.hpp"
#include "truepose/printers/mistakes.hpp"

namespace truepose::printers {
constexpr double kRefit = 0.98, kNothing = 1e-6, kTheSame = 1e-6, kWorse = 1.15;
constexpr char kWhere[] = "[delta_calibrate] ", kKlippers[] = "Klipper's criterion";
/// Klipper's words, and those for other firmwares.
constexpr pair<const char*, const char*> kOtherWords[] = {
    {kWhere, ""},
    {"microsteps, gear and rotation_distance", "the steps per mm"},
    {"microsteps or rotation_distance", "the steps per mm"},
    {kTakeOut, "take its line out"},
    {"Klipper's z", "the fit's z"},
    {kKlippers, "a fit of radius, angles and endstops"},
    {"he file's parameters", "he settings"},
    {"the file's", "the text's"},
    {"the file, which", "the text, which"},
    {"; distances on a print would tell more", ""},
};
constexpr double kClear = 0.5;   ///< share of the residuals that a remedy leaves at most
constexpr double kUnseen = 0.1;  ///< share of the noise below which no difference is named
constexpr double kIdentified = 0.3, kBarely = 0.9;  ///< largest posterior over prior σ

/// Request of a caller.
struct Request {
  double arm = 0;              ///< m; 0: as in the file
  double probe_radius = 0;     ///< mm; 0: unknown
  int next = 0;                ///< readings to plan
  bool heights_alone = false;  ///< in the plan
  Assumed assumed;
};

/// Assessment of a printer.
struct Assessment {
  Config config;  ///< with an error, the rest is unset
  Printer printer;
  Prior prior;
  Assumed found_noise;  ///< assumed before, with the readings' noise as the estimate has it
  bool read = false;    ///< false: a plan of first readings alone
  Vector klipper;       ///< parameters by Klipper's criterion
  Estimate estimate;
  Judged judged;
  Linear linear;
  vector<Vector> fits;         ///< residuals of the file's parameters, Klipper's, the estimate's
  bool as_klipper, as_theirs;  ///< the file's parameters are Klipper's criterion's, the estimate's
  bool as_good;                ///< they leave as little, within a tenth of the noise
  vector<Residuals> held_out;  ///< empty: too few
  Bed before, after;
  vector<string> notes, words, assumptions;
  string verdict;
  bool rely = false;
  vector<Planned> plan;

  int heights() const { return heights_of(printer.readings); }
  bool extended() const { return heights() < int(printer.readings.size()); }
  /// Residuals of a calibration method at left-out readings.
  const Residuals& way(string_view name) const {
    return *std::find_if(held_out.begin(), held_out.end(),
                         [&](const Residuals& each) { return each.name.starts_with(name); });
  }
  /// RMS of the residuals of the heights, or of the distances.
  double left(const Vector& off, bool distances = false) const {
    return rms_finite(distances ? off.tail(off.size() - heights()) : off.head(heights()));
  }
  string left_text(const Vector& off) const {
    return "z " + shown_mm(left(off)) + " mm" +
           (extended() ? ", distances " + shown_mm(left(off, true)) + " mm" : "");
  }
};

inline const char* verdict_of(double prior_sigma, double sigma) {
  const double ratio = sigma / prior_sigma;
  return ratio <= kIdentified ? "identified" : ratio <= kBarely ? "barely" : "not identified";
}

/// The prior-consistency (χ²) test: by the law of total variance û scatters by I - Σ_u from printer
/// to printer, along each eigenvector of Σ_u: û_k² / (1 - σ_k²) are χ²₁. Empty where it passes.
inline string tolerances_note(const Estimate& found) {
  constexpr double kSeen = 1.0 / 3;
  const Eigen::SelfAdjointEigenSolver<Matrix> parts(found.P);
  const Vector u = parts.eigenvectors().transpose() * found.u, variance = parts.eigenvalues();
  double chi2 = 0;
  int seen = 0;
  for (int k = 0; k < u.size(); ++k)
    if (variance[k] <= kSeen * kSeen) chi2 += u[k] * u[k] / (1 - variance[k]), ++seen;
  if (seen == 0 || chi2_tail(chi2, seen) >= kFalseAlarm) return {};
  return format(
      "the assumed σ seem too small by a factor of about %.1f, judged by %d combinations of "
      "parameters that the readings determine; other parameters' σ are then too small too",
      sqrt(chi2 / seen), seen);
}

/// The outlier's deviation from the prediction of all others as text.
inline string departing(const Assessment& of) {
  const int k = of.judged.wrong;
  const Reading& reading = of.printer.readings[k];
  return reading.name + format(" = %.6g: %+.2f mm off what all else says, ± %.2f",
                               reading.value / kMm, of.judged.off[k] / kMm,
                               of.judged.scale[k] / kMm);
}

/// What makes Klipper's file unfit for its own readings, with the remedy; empty if it is not known.
/// A value in the main section overrides that of SAVE_CONFIG; angles as nominal: only endstops, or
/// endstops and radius, were calibrated.
inline string diagnosis(const Assessment& of) {
  if (of.config.kind != "klipper" || of.as_klipper || of.as_good || of.as_theirs) return {};
  const auto uneven = [&](const Vector& off) {  // less a common shift, which is the Z offset's
    const Vector z = off.head(of.heights());
    return sqrt((z.array() - z.mean()).square().sum() / double(z.size() - 1));
  };
  const double now = uneven(of.fits[0]);
  Config saved = of.config;
  string places;
  for (const auto& [place, value] : of.config.saved)
    if (string& own = saved.values[place]; own != value) {
      places += (places.empty() ? "[" : ", [") + place.first + "] " + place.second + " = " +
                one_line(own) + " (saved: " + one_line(value) + ")";
      own = value;
    }
  const double then = places.empty() ? kNaN : uneven(off_by(of.printer, printer_of(saved).theta));
  const auto becomes = [&](double then_) {
    return ". Heights are then even to " + shown_mm(then_) + " mm rms, now to " + shown_mm(now);
  };
  if (then < kClear * now)
    return "The main section overrides what SAVE_CONFIG wrote: " + places +
           ". Comment these lines out and restart" + becomes(then);
  const Delta& delta = of.printer.delta;
  bool nominal = !delta.rotary;
  for (int i = 0; i < 3; ++i)
    nominal =
        nominal && fabs(of.printer.theta[delta.angle() + i] / kDegree - kTurns[0][i]) < kTheSame;
  if (const double least = uneven(of.fits[1]); nominal && least < kClear * now)
    return format(
               "Only the endstops are calibrated: the towers' angles are the drawing's "
               "(delta_radius = %.6g). Run DELTA_CALIBRATE and SAVE_CONFIG, or use the estimate",
               of.printer.theta[0] / kMm) +
           becomes(least);
  return {};
}

/// Whether the file's parameters are the fit of its readings.
inline string fit_in_words(const Assessment& of) {
  const string file = "The file's parameters ";
  if (!of.fits[0].head(of.heights()).allFinite())
    return file + "cannot bring the nozzle to where its readings were taken";
  const string left = of.left_text(of.fits[0]), least = of.left_text(of.fits[1]);
  if (of.as_theirs)
    return file + "are truepose's estimate, not what Klipper's criterion gives; left over: " +
           of.left_text(of.fits[2]) + " rms";
  if (of.as_klipper)
    return file + "are what Klipper's criterion gives; left over: " + left + " rms";
  string away;
  double most = -1;
  for (int k = 0; k < of.printer.delta.count(); ++k) {
    const Option& option = of.printer.options[k];
    const double off = fabs(of.klipper[k] - of.printer.theta[k]) / option.scale();
    if (!(off > most)) continue;
    most = off;
    away = option.name + format(" off by %.2f%s", off, option.angle() ? "°" : " mm");
  }
  if (left == least || of.as_good)
    return file + "fit the file's readings as those of Klipper's criterion do (" + left + " rms" +
           (left == least ? "" : "; Klipper's " + least) + "), " + away;
  return file + "do not fit the file's readings (" + left + " rms; Klipper's criterion leaves " +
         least + ", " + away + "): they were changed since, or the readings are older";
}

inline string distances_in_words(const Assessment& of) {
  if (!of.extended())
    return "Heights alone: arms are the drawing's, whatever a fit of them would say; distances on "
           "a print would tell more";
  vector<double> values;
  for (const Reading& each : of.printer.readings)
    if (each.distance) values.push_back(each.value / kMm);
  if (values.size() < 2) return {};
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const Residuals& klipper = of.way("Klipper's");
  const double mean = of.left(of.way(kMean).off, true);
  bool best = *high - *low < 0.02 * median(values);
  for (const Residuals& way : of.held_out) best = best && !(of.left(way.off, true) < mean);
  if (!best) return {};
  return format(
      "%d distances of nearly one length (%.2f to %.2f mm) do not support %s: their "
      "plain mean predicts one that was left out to %s mm, %s to %s",
      int(values.size()), *low, *high, klipper.name.substr(10).c_str(), shown_mm(mean).c_str(),
      klipper.name.c_str(), shown_mm(of.left(klipper.off, true)).c_str());
}

/// The noise of the readings.
inline string noise_in_words(const Assessment& of) {
  const Noise& noise = of.judged.noise;
  string said = "Noise of the readings, as they fit the printer: ";
  for (int kind = 0; kind <= of.extended(); ++kind)
    said += format("%s ± %s mm (%.0f degrees of freedom)", kind ? ", distances" : "heights",
                   shown_mm(noise.sigma[kind]).c_str(), noise.dof[kind]);
  return said + "; every σ counts it";
}

/// What is missing for a verdict; empty if nothing is.
inline string missing_in_words(const Assessment& of) {
  if (of.judged.wrong >= 0 || of.judged.scattered || of.judged.least <= kError) return {};
  const int more =
      more_heights(of.printer.delta, of.estimate, of.linear, of.judged.noise, of.printer.radius);
  return format(
      "Too few readings to judge this calibration: an error of one height would show from %s mm "
      "on. To show one of %g mm, add %d heights, spread evenly over the bed%s",
      shown_mm(of.judged.least).c_str(), kError / kMm, more ? more : kMostAdvised,
      more ? "" : ", and probe each point several times: the noise hides it");
}

/// Whether to use the calibration; sets `rely`. `steps`: wrong steps that explain the readings.
inline string use(Assessment& of, const string& steps) {
  const string arms = format("whether the arms as drawn are %g mm", of.printer.arm / kMm);
  if (of.judged.wrong >= 0)
    return "Do not rely on this calibration: " + steps + departing(of) + ". Measure it again, or " +
           kTakeOut;
  if (of.judged.scattered)
    return "Do not rely on this calibration: " + steps + "heights are " +
           shown_mm(of.judged.noise.sigma[0]) +
           " mm off any such printer's. Level and clean the bed, look for loose joints and " +
           arms + ", and calibrate again";
  const double before = of.before.rms().norm(), after = of.after.rms().norm();
  const string errors =
      "expected error over the bed " + shown_mm(before) + " mm with the file's parameters";
  const string keep = "Keep the file's parameters: ";
  if (const string said = diagnosis(of); !said.empty()) {
    of.rely = true;
    return said;
  }
  if (of.held_out.empty() || of.after.rms()[2] > kLayer)
    return "Read more heights before anything rests on this calibration (--plan 6 says which): " +
           errors + ", " + shown_mm(after) + " with the estimate";
  of.rely = true;
  if (!isfinite(before))
    return "Use the estimate: with the file's parameters the nozzle does not reach the bed";
  if (of.as_theirs) return keep + "they are the estimate; " + errors;
  if ((of.as_klipper || of.as_good) && unlike_arms(of.printer.delta, of.printer.theta).empty())
    return keep + "they fit the readings, and the estimate predicted other sessions of real " +
           "printers no better (" + errors + ", " + shown_mm(after) + " with it)";
  const Residuals& theirs = of.extended() ? of.way("Klipper's") : of.held_out[0];
  const double ours = rms_finite(of.way(kEstimate).off), by_theirs = rms_finite(theirs.off);
  const string left_out = "readings that were left out are predicted to " + shown_mm(ours) +
                          " mm by the estimate and to " + shown_mm(by_theirs) + " by " +
                          theirs.name;
  if (ours > kWorse * by_theirs)
    return "Check " + arms + " before you use the estimate: " + left_out;
  if (before < kWorse * after)
    return keep + errors + ", " + shown_mm(after) + " with the estimate: too small a difference";
  return "Use the estimate: " + errors + ", " + shown_mm(after) + " with it; " + left_out;
}

/// Assess the readings: Config::error, or all that the answer says of them.
inline void assess_readings(Assessment& of, auto&& stop) {
  const Delta& delta = of.printer.delta;
  const Readings& readings = of.printer.readings;
  const Assumed& assumed = of.printer.assumed;
  if (const string said = changed_steps(of.printer); !said.empty()) return stop(kWhere + said);
  const Vector nominal = off_by(of.printer, of.prior.mean);
  for (int k = 0; k < nominal.size(); ++k)
    if (!isfinite(nominal[k]))
      return stop(kWhere + wrong_steps(of.printer) + readings[k].name +
                  ": the nozzle cannot have been there; " + kChanged +
                  ", or are lengths in other units than mm?");
  const Estimate first = estimate(delta, readings, of.prior, assumed);
  of.linear = linear(delta, readings, first);
  of.judged = judge(of.linear, assumed);
  for (const bool kind : {false, true})
    of.found_noise.sigma[TRUEPOSE_PRINTER_HEIGHT + kind] = of.judged.noise.deviation(kind);
  of.estimate = estimate(delta, readings, of.prior, of.found_noise);
  const Vector& theta = of.estimate.theta;
  const Vector own = off_by(of.printer, theta), file = off_by(of.printer, of.printer.theta);
  const double most = max(of.left(own), of.left(own, true));
  const bool unfit = !(most <= kUnfit) || !own.allFinite() || !theta.allFinite() ||
                     !of.estimate.covariance.allFinite() || !of.linear.y.allFinite();
  string said = mistyped(of.printer, theta, own, unfit);
  if (unfit && said.empty())
    said = "no such printer has these readings (left over: " + of.left_text(own) +
           " rms): are some wrong, or " + kChanged + "?";
  if (!said.empty()) return stop(kWhere + wrong_steps(of.printer) + said);
  of.klipper = fit(delta, file.allFinite() ? of.printer.theta : of.prior.mean, readings,
                   adjusted(delta, of.extended()));
  of.fits = {file, off_by(of.printer, of.klipper), own};
  of.held_out = held_out(delta, readings, of.klipper, of.prior.mean, of.judged);
  of.before = over_the_bed(delta, of.printer.theta, of.estimate, of.printer.radius);
  of.after = over_the_bed(delta, theta, of.estimate, of.printer.radius);
  const bool outlier = of.judged.wrong >= 0;
  for (const string& note : {outlier ? departing(of) : "", tolerances_note(of.estimate),
                             unlike_arms(delta, of.printer.theta)})
    if (!note.empty()) of.notes.push_back(note);
  const auto cost = [&](int k) {
    return of.fits[k].cwiseProduct(klipper_weights(readings)).squaredNorm();
  };
  of.as_good = true;
  for (int kind = 0; kind <= of.extended(); ++kind)
    of.as_good &=
        of.left(file, kind) - of.left(of.fits[1], kind) < kUnseen * of.judged.noise.sigma[kind];
  of.as_klipper = cost(1) >= kRefit * cost(0) - kNothing * kNothing;
  of.as_theirs = (theta - of.printer.theta).head(delta.count()).cwiseAbs().maxCoeff() < kTheSame;
  of.verdict =
      use(of, outlier || of.judged.scattered ? wrong_steps(of.printer, kRival * most, 3) : "");
  for (const string& line : {of.verdict, fit_in_words(of), missing_in_words(of),
                             distances_in_words(of), noise_in_words(of)})
    if (!line.empty()) of.words.push_back(line);
}

/// An assessment in Klipper's words.
inline Assessment assessed(string_view text, const Request& request) {
  Assessment of;
  Config& config = of.config = read(text, request.probe_radius);
  if (config.error.empty()) of.printer = printer_of(config);
  if (!config.error.empty()) return of;
  const Delta& delta = of.printer.delta;
  const auto stop = [&](const string& said) {
    config.fail(said +
                (request.arm > 0 ? format(" (or is --arm %g wrong?)", request.arm / kMm) : ""));
  };
  const int heights = of.heights();
  const string arms = unlike_arms(delta, of.printer.theta);
  of.read = !of.printer.readings.empty() || !of.printer.gaps.empty() || request.next == 0;
  if (of.read && heights < kFewest) {
    string said =
        kWhere + (heights
                      ? format("%d heights: Klipper probes %d at least", heights, kFewest)
                      : string(of.extended() ? "distances, but no heights" : "no saved readings") +
                            "; DELTA_CALIBRATE and SAVE_CONFIG write them");
    for (const string& gap : of.printer.gaps) said += ". And " + gap;
    if (!arms.empty()) said += ". And " + arms;
    if (config.kind != "klipper")
      said = format("%d probed points: 3 at least, 13 are better; for %s give %s", heights,
                    dialect_of(config.kind).name, dialect_of(config.kind).probing);
    config.fail(said);
    return of;
  }
  of.notes = of.printer.notes;
  of.found_noise = request.assumed;
  of.printer.assumed = request.assumed;
  if (request.arm > 0) of.printer.arm = request.arm, of.printer.arm_said = "--arm";
  of.prior = prior(of.printer);
  of.assumptions = {
      format("Arms as drawn: %g mm (%s)", of.printer.arm / kMm, of.printer.arm_said.c_str()),
      "σ assumed beforehand: " + request.assumed.text()};
  for (int i = 0; i < 3; ++i)
    if (!isfinite(delta.homed(of.prior.mean, i)))
      stop("an arm does not reach the middle at its endstop");
  const bool heights_alone = request.heights_alone || config.kind != "klipper";
  const int enough = of.read ? 0 : int(adjusted(delta, false).cols()) + 1;
  if (enough) {
    of.estimate = estimate(delta, {}, of.prior, request.assumed);
    if (!heights_alone)
      of.assumptions.push_back(format(
          "Heights come first, %d of them, one more than Klipper adjusts parameters by: before "
          "that nothing can be printed",
          enough));
  } else if (config.error.empty()) {
    assess_readings(of, stop);
  }
  if (request.next == 0 || !config.error.empty()) return of;
  of.plan = next_readings(of.printer, of.estimate, of.found_noise, request.next,
                          heights_alone ? request.next : enough);
  if (of.plan.empty())
    stop("the nozzle cannot be over the bed");
  else if (int(of.plan.size()) <= request.next)
    stop(format("--plan %d: only %d candidates are reachable", request.next,
                int(of.plan.size()) - 1));
  return of;
}

/// Assess a printer from its text, in the words of its firmware. Config::error of the result is one
/// line on what is wrong in it.
inline Assessment assess(string_view text, const Request& request) {
  Assessment of = assessed(text, request);
  if (of.config.kind == "klipper") return of;
  const auto say = [](string& line) {
    for (const auto& [from, to] : kOtherWords) line = replaced(line, from, to);
  };
  for (vector<string>* all : {&of.notes, &of.words, &of.assumptions})
    std::for_each(all->begin(), all->end(), say);
  say(of.config.error);
  say(of.verdict);
  return of;
}
}  // namespace truepose::printers
