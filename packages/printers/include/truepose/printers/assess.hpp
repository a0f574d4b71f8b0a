// Assessment of a printer: fits, estimate, held-out errors, and conclusions in words.
#pragma once

#include "truepose/printers/bed.hpp"
#include "truepose/printers/gcode.hpp"
#include "truepose/printers/steps.hpp"

namespace truepose::printers {
constexpr double kRefit = 0.98, kNothing = 1e-6, kTheSame = 1e-6, kWorse = 1.15;
constexpr double kManual = 0.1 * kMm;  ///< heights probed by hand are 0, or the paper's thickness
constexpr double kIdentified = 0.3, kBarely = 0.9;  ///< largest posterior over prior σ

/// Request of a caller.
struct Request {
  double arm = 0;           ///< m; 0: as in the file
  double probe_radius = 0;  ///< mm; 0: unknown
  int next = 0;             ///< readings to plan
  Assumed assumed;
};

/// Assessment of a printer.
struct Assessment {
  Config config;  ///< with an error, the rest is unset
  Printer printer;
  Prior prior;
  Assumed assumed, found_noise;  ///< of the readings: before, and as the estimate has it
  bool read = false;             ///< false: a plan of first readings alone
  Vector klipper;                ///< parameters by Klipper's criterion
  Estimate estimate;
  Judged judged;
  Linear linear;
  vector<Residuals> fits, held_out;  ///< the file's, Klipper's, the estimate's; empty: too few
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
  Vector of_heights(const Residuals& of) const { return of.off.head(heights()); }
  Vector of_distances(const Residuals& of) const { return of.off.tail(of.off.size() - heights()); }
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
  double chi2 = 0;
  int seen = 0;
  for (int k = 0; k < found.u.size(); ++k)
    if (const double variance = parts.eigenvalues()[k]; variance <= kSeen * kSeen) {
      const double u = parts.eigenvectors().col(k).dot(found.u);
      chi2 += u * u / (1 - variance);
      ++seen;
    }
  if (seen == 0 || chi2_tail(chi2, seen) >= kFalseAlarm) return {};
  return format(
      "the assumed σ seem too small by a factor of about %.1f, judged by the %d "
      "combination%s of parameters that the readings determine; other parameters' σ are "
      "then too small too",
      sqrt(chi2 / seen), seen, seen == 1 ? "" : "s");
}

/// A reading's deviation from the prediction of all others as text.
inline string departing(const Assessment& of, int k) {
  const Reading& reading = of.printer.readings[k];
  return reading.name + format(" = %.6g: %+.2f mm off what all else says, ± %.2f",
                               reading.value / kMm, of.judged.off[k] / kMm,
                               of.judged.scale[k] / kMm);
}

inline string left_over_text(const Assessment& of, size_t fit) {
  const string distances = ", distances " + shown_mm(rms(of.of_distances(of.fits[fit]))) + " mm";
  return "z " + shown_mm(rms(of.of_heights(of.fits[fit]))) + " mm" +
         (of.extended() ? distances : "");
}

/// Whether the file's parameters are the fit of its readings.
inline string fit_in_words(const Assessment& of, bool as_klipper, bool holds_estimate) {
  if (!of.of_heights(of.fits[0]).allFinite())
    return "The file's parameters cannot bring the nozzle to where its readings were taken";
  const string left = left_over_text(of, 0), least = left_over_text(of, 1);
  if (holds_estimate)
    return "The file's parameters are truepose's estimate, not what Klipper's criterion gives; "
           "left over: " +
           left_over_text(of, 2) + " rms";
  if (as_klipper)
    return "The file's parameters are what Klipper's criterion gives; left over: " + left + " rms";
  const vector<Option>& all = of.printer.options;
  size_t most = 0;
  vector<double> off;
  for (int k = 0; k < of.printer.delta.count(); ++k) {
    off.push_back(fabs(of.klipper[k] - of.printer.theta[k]) / all[k].scale());
    if (off[k] > off[most]) most = k;
  }
  const string away =
      all[most].name + format(" off by %.2f%s", off[most], all[most].angle() ? "°" : " mm");
  if (left == least)
    return "The file's parameters fit the file's readings as those of Klipper's criterion do (" +
           left + " rms), " + away;
  return "The file's parameters do not fit the file's readings (" + left +
         " rms; Klipper's criterion leaves " + least + ", " + away +
         "): they were changed since, or the readings are older";
}

inline vector<string> distances_in_words(const Assessment& of) {
  if (!of.extended())
    return {
        "Heights alone: arms are the drawing's, whatever a fit of them would say; distances on a "
        "print would tell more"};
  vector<double> values;
  for (const Reading& each : of.printer.readings)
    if (each.distance) values.push_back(each.value / kMm);
  if (values.size() < 2) return {};
  const auto left = [&](const Residuals& way) { return rms_finite(of.of_distances(way)); };
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const Residuals& klipper = of.way("Klipper's");
  const double mean = left(of.way(kMean));
  if (*high - *low >= 0.02 * median(values) ||
      std::any_of(of.held_out.begin(), of.held_out.end(),
                  [&](const Residuals& way) { return left(way) < mean; }))
    return {};
  return {
      format("%d distances of nearly one length (%.2f to %.2f mm) do not support %s: their "
             "plain mean predicts one that was left out to %s mm, %s to %s",
             int(values.size()), *low, *high, klipper.name.substr(10).c_str(),
             shown_mm(mean).c_str(), klipper.name.c_str(), shown_mm(left(klipper)).c_str())};
}

/// The noise of the readings, and whether they suffice for a verdict.
inline vector<string> noise_in_words(const Assessment& of) {
  const Noise& noise = of.judged.noise;
  string said = "Noise of the readings, as they fit the printer: heights ± " +
                shown_mm(noise.sigma[0]) + format(" mm (%.0f degrees of freedom)", noise.dof[0]);
  if (of.extended())
    said += ", distances ± " + shown_mm(noise.sigma[1]) +
            format(" mm (%.0f degrees of freedom)", noise.dof[1]);
  vector<string> lines{said + "; every σ counts it"};
  if (of.judged.wrong >= 0 || of.judged.scattered || of.judged.least <= kError) return lines;
  const int more = more_heights(of.printer.delta, of.estimate, of.linear, noise, of.printer.radius);
  lines.push_back(
      "Too few readings to judge this calibration: an error of one height would show from " +
      shown_mm(of.judged.least) +
      format(" mm on. To show one of %g mm, add %d heights, spread evenly "
             "over the bed%s",
             kError / kMm, more ? more : kMostAdvised,
             more ? "" : ", and probe each point several times: the noise hides it"));
  return lines;
}

/// Whether to use the calibration; sets `rely`. `steps`: wrong steps that explain the readings.
inline string use(const Assessment& of, bool as_klipper, bool holds_estimate, const string& steps,
                  bool& rely) {
  const double arm = of.prior.arm / kMm;
  rely = false;
  if (of.judged.wrong >= 0)
    return "Do not rely on this calibration: " + steps + departing(of, of.judged.wrong) +
           ". Measure it again, or " + kTakeOut;
  if (of.judged.scattered)
    return "Do not rely on this calibration: " + steps + "heights are " +
           shown_mm(of.judged.noise.sigma[0]) +
           format(
               " mm off any such printer's. Level and clean the bed, look for loose joints and "
               "whether the "
               "arms as drawn are %g mm, and calibrate again",
               arm);
  const double before = of.before.rms().norm(), after = of.after.rms().norm();
  const string errors =
      "expected error over the bed " + shown_mm(before) + " mm with the file's parameters";
  if (of.held_out.empty() || of.after.rms()[2] > kLayer)
    return "Read more heights before anything rests on this calibration (--plan 6 says which): " +
           errors + ", " + shown_mm(after) + " with the estimate";
  rely = true;
  if (!isfinite(before))
    return "Use the estimate: with the file's parameters the nozzle does not reach the bed";
  const Residuals& theirs = of.extended() ? of.way("Klipper's") : of.held_out[0];
  const double ours = rms_finite(of.way(kEstimate).off), by_theirs = rms_finite(theirs.off);
  const string left_out = "readings that were left out are predicted to " + shown_mm(ours) +
                          " mm by the estimate and to " + shown_mm(by_theirs) + " by " +
                          theirs.name;
  if (ours > kWorse * by_theirs)
    return string(as_klipper ? "Keep the file's" : "Use Klipper's") +
           format(" parameters, and look whether the arms as drawn are %g mm: ", arm) + left_out;
  if (holds_estimate) return "Keep the file's parameters: " + errors + ", which are the estimate";
  if (before < kWorse * after)
    return "Keep the file's parameters: " + errors + ", " + shown_mm(after) +
           " with the estimate, which the readings do not tell apart";
  return "Use the estimate: " + errors + ", " + shown_mm(after) + " with it; " + left_out;
}

/// Assess a printer from its text. Config::error of the result is one line on what is wrong in it.
inline Assessment assess(string_view text, const Request& request) {
  Assessment of;
  Config& config = of.config = read(text, request.probe_radius);
  if (config.error.empty()) of.printer = printer_of(config);
  if (!config.error.empty()) return of;
  const Delta& delta = of.printer.delta;
  const Readings& readings = of.printer.readings;
  const Assumed& assumed = of.assumed = request.assumed;
  const string where = "[" + string(kSection) + "] ";
  const auto stop = [&](const string& said) {
    config.fail(said +
                (request.arm > 0 ? format(" (or is --arm %g wrong?)", request.arm / kMm) : ""));
    return std::move(of);
  };
  const int heights = of.heights();
  bool any = false;  // readings of any kind, even behind a gap
  if (const auto section = config.values.find(kSection); section != config.values.end())
    for (const auto& [option, _] : section->second)
      any = any || (digit(option.back()) &&
                    (option.starts_with("height") || option.starts_with("manual_height") ||
                     option.starts_with("distance")));
  of.read = any || request.next == 0;
  if (of.read && heights < kFewest) {
    if (config.kind != "klipper") {
      config.fail(format("%d probed points: %d at least, better 13, by %s", heights, kFewest,
                         config.kind == "marlin" ? "G30 X… Y…" : "bed.g"));
      return of;
    }
    string said = heights ? format("%d heights: Klipper probes %d at least", heights, kFewest)
                  : of.extended()
                      ? "distances, but no heights; DELTA_CALIBRATE and SAVE_CONFIG write them"
                      : "no saved readings; DELTA_CALIBRATE and SAVE_CONFIG write them";
    for (const string& gap : gaps(config, {"manual_height", "height"}))
      said += (heights ? "; " : ". And ") + gap;
    const string arms = unlike_arms(delta, of.printer.theta);
    if (!heights && !arms.empty()) said += ". And " + arms;
    config.fail("[" + string(kSection) + "]: " + said);
    return of;
  }
  of.prior = prior(of.printer, config, assumed, request.arm);
  of.assumptions = {
      format("Arms as drawn: %g mm (%s)", of.prior.arm / kMm, of.prior.arm_said.c_str()),
      "σ assumed beforehand: " + assumed.text()};
  for (int i = 0; i < 3; ++i)
    if (!isfinite(delta.homed(of.prior.mean, i)))
      return stop("an arm does not reach the middle at its endstop");
  if (!of.read) {
    of.estimate = estimate(delta, {}, of.prior, assumed);
    const int enough = int(adjusted(delta, false).cols()) + 1;
    of.plan = next_readings(of.printer, of.estimate, assumed, request.next, enough);
    of.assumptions.insert(
        of.assumptions.begin(),
        format(
            "Heights come first, %d of them, one more than Klipper adjusts parameters by: before "
            "that nothing can be printed",
            enough));
  } else {
    if (const string said = changed_steps(of.printer); !said.empty()) return stop(where + said);
    if (const string said = mistake(of.printer, config, of.prior, assumed); !said.empty())
      return stop(where + wrong_steps(of.printer, config, assumed, request.arm) + said);
    const Estimate first = estimate(delta, readings, of.prior, assumed);
    of.linear = linear(delta, readings, first);
    of.judged = judge(of.linear, assumed);
    of.found_noise = assumed;
    for (const bool kind : {false, true})
      of.found_noise.sigma[TRUEPOSE_PRINTER_HEIGHT + kind] = of.judged.noise.deviation(kind);
    of.estimate = estimate(delta, readings, of.prior, of.found_noise);
    const Vector& theta = of.estimate.theta;
    const Residuals own{kEstimate, errors(delta, theta, readings).off};
    const double left[2] = {rms(of.of_heights(own)), of.extended() ? rms(of.of_distances(own)) : 0};
    if (!(max(left[0], left[1]) <= kUnfit) || !theta.allFinite() ||
        !of.estimate.covariance.allFinite() || !of.linear.y.allFinite())
      return stop(where + wrong_steps(of.printer, config, assumed, request.arm) +
                  format("no such printer has these readings: %.2f mm rms of the heights and %.2f "
                         "of the distances are "
                         "left over; are some wrong, or %s?",
                         left[0] / kMm, left[1] / kMm, kChanged));
    string steps;
    if (of.judged.wrong >= 0 || of.judged.scattered)
      steps =
          wrong_steps(of.printer, config, assumed, request.arm, kRival * max(left[0], left[1]), 3);
    const Vector file = errors(delta, of.printer.theta, readings).off;
    of.klipper = fit(delta, file.allFinite() ? of.printer.theta : of.prior.mean, readings,
                     adjusted(delta, of.extended()));
    of.fits = {{"the file's parameters", file},
               {"Klipper's criterion", errors(delta, of.klipper, readings).off},
               own};
    of.held_out = held_out(delta, readings, of.klipper, of.prior.mean, of.judged);
    of.before = over_the_bed(delta, of.printer.theta, of.estimate, of.printer.radius);
    of.after = over_the_bed(delta, theta, of.estimate, of.printer.radius);
    of.notes = of.printer.notes;
    const auto note = [&](const string& said) {
      if (!said.empty()) of.notes.push_back(said);
    };
    if (of.judged.wrong >= 0) note(departing(of, of.judged.wrong));
    note(tolerances_note(of.estimate));
    note(unlike_arms(delta, of.printer.theta));
    vector<double> probed;
    for (const Reading& each : readings)
      if (each.probed) probed.push_back(each.value / kMm);
    const string probe = probe_of(config);
    const bool manual = std::all_of(probed.begin(), probed.end(),
                                    [](double z) { return fabs(z) <= kManual / kMm; });
    if (!probe.empty() && !manual && config.has(probe, "z_offset")) {
      const double z = config.number(probe, "z_offset"), middle = median(probed);
      if (fabs(z - middle) > 0.5)
        note(
            format("[%s] z_offset = %.6g mm, but the heights were probed at %.6g mm: it was "
                   "changed since; z = 0 is "
                   "off by that much for these readings",
                   probe.c_str(), z, middle));
    }
    const bool as_klipper =
        klipper_cost(delta, of.klipper, readings) >=
        kRefit * klipper_cost(delta, of.printer.theta, readings) - kNothing * kNothing;
    const bool holds =
        (theta - of.printer.theta).head(delta.count()).cwiseAbs().maxCoeff() < kTheSame;
    of.words = {fit_in_words(of, as_klipper, holds)};
    for (const auto& lines : {distances_in_words(of), noise_in_words(of)})
      of.words.insert(of.words.end(), lines.begin(), lines.end());
    of.words.push_back(of.verdict = use(of, as_klipper, holds, steps, of.rely));
    if (request.next > 0)
      of.plan = next_readings(of.printer, of.estimate, of.found_noise, request.next, 0);
  }
  if (request.next > 0 && of.plan.empty()) return stop("the nozzle cannot be over the bed");
  if (request.next > 0 && int(of.plan.size()) <= request.next)
    return stop(format("--plan %d: only %d candidates are reachable", request.next,
                       int(of.plan.size()) - 1));
  return of;
}
}  // namespace truepose::printers
