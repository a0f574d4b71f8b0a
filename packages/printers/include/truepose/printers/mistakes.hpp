// Causes of readings that fit no printer: another unit, a mistyped one, other steps of the motors.
#pragma once

#include "truepose/printers/judge.hpp"

namespace truepose::printers {
constexpr double kUnfit = 1 * kMm;
constexpr double kRival = 0.3;  ///< rms under other steps over that under the file's: not worse

/// Prediction errors of a printer's readings by parameters.
inline Vector off_by(const Printer& printer, const Vector& theta) {
  return errors(printer.delta, theta, printer.readings).off;
}
/// The estimate of a printer with other step distances or readings.
inline Vector refit(const Printer& printer) {
  return estimate(printer.delta, printer.readings, prior(printer), printer.assumed).theta;
}

/// Step distances of one motor or of all, wrong by a factor, that leave less than `most`: an
/// explanation of readings that no printer fits with its own; empty if there is none. `first` 3:
/// of all alone.
inline string wrong_steps(const Printer& printer, double most = HUGE_VAL, int first = 0) {
  double least = min(most, 0.2 * kMm);
  string said;
  for (int i = first; i <= 3; ++i)
    for (const double factor : {0.25, 0.5, 2.0 / 3, 0.8, 1.25, 1.5, 2.0, 4.0}) {
      Printer other = printer;
      for (int motor = 0; motor < 3; ++motor)
        if (i == 3 || i == motor) other.delta.step[motor] /= factor;
      const double left = rms(off_by(other, refit(other)));
      if (!(left < least)) continue;
      least = left;
      said = (i == 3 ? string("all motors: their") : format("stepper_%c: its", "abc"[i])) +
             format(
                 " step is %.3g times the true one: look at microsteps, gear and "
                 "rotation_distance; if not that, ",
                 factor);
    }
  return said;
}

/// The factor by which the steps of all motors were changed since the readings, if the file's
/// parameters fit these only with the former steps; else empty. Endstops that were all changed
/// alike shift the heights alike: that must explain much less.
inline string changed_steps(const Printer& printer) {
  constexpr double kGrid = 1.01, kClear = 0.2;
  constexpr int kMost = 280;  // a factor of 16
  Vector off = off_by(printer, printer.theta);
  if (rms(off) < kUnfit) return {};
  auto heights = off.head(heights_of(printer.readings));
  heights.array() -= heights.mean();
  const auto finite = [](double value) { return isfinite(value) ? value : HUGE_VAL; };
  const auto left = [&](double power) {
    Printer former = printer;
    former.delta.step *= pow(kGrid, power);
    return finite(rms(off_by(former, printer.theta)));
  };
  double at = 0;
  for (int k = -kMost; k <= kMost; ++k)
    if (left(k) < left(at)) at = k;
  for (double step = 0.5; step > 1e-6; step *= 0.5)
    at += left(at - step) < left(at) ? -step : left(at + step) < left(at) ? step : 0;
  if (!(left(at) < min(kClear * finite(rms(off)), kRival * kUnfit))) return {};
  return format(
      "the steps of all motors are %.3g times as long as in these readings: with the "
      "former ones the file's parameters leave %s mm rms; %s?",
      pow(kGrid, -at), shown_mm(left(at)).c_str(), kChanged);
}

/// Distances in another unit, or where the readings are `unfit` a mistyped one, that explain the
/// residuals `off` of the parameters `theta`; empty if there are none.
inline string mistyped(const Printer& printer, const Vector& theta, const Vector& off, bool unfit) {
  constexpr double kFactor = 0.05;
  constexpr size_t kMany = 30;  // readings, of which a gross one alone is far off
  const Readings& readings = printer.readings;
  const auto unit = [&](double ratio, const string& otherwise) {
    for (const auto& [factor, name] : {pair(1 / 25.4, "inches"), pair(0.1, "cm"), pair(1e-3, "m"),
                                       pair(1e3, "µm"), pair(25.4, "mm of inches")})
      if (fabs(ratio / factor - 1) < kFactor) return "in " + string(name) + " (Klipper takes mm)?";
    return otherwise;
  };
  const double kept = 1 - theta[printer.delta.count()], width = theta[printer.delta.count() + 1];
  vector<double> ratios;  // of distances to the nozzle's ways
  for (size_t k = 0; k < readings.size(); ++k)
    if (const double value = readings[k].value; readings[k].distance)
      ratios.push_back(value * kept / (value + off[k] - width));
  const double ratio = median(ratios);
  const string all = format("distances are %.3g times as long as the nozzle's ways: ", ratio);
  if (const string said = unit(ratio, ""); !said.empty()) return all + said;
  double least = 0.2 * rms(off);
  string said;
  for (size_t k = 0; unfit && k < readings.size(); ++k) {
    const Reading& of = readings[k];
    if (readings.size() > kMany && fabs(off[k]) < 2 * rms(off)) continue;
    Printer others = printer;
    others.readings.erase(others.readings.begin() + std::ptrdiff_t(k));
    if (heights_of(others.readings) < kFewest) continue;
    const Vector by = refit(others);
    const double left = rms(off_by(others, by));
    if (!(left < least)) continue;
    least = left;
    const double expected = of.value + errors(printer.delta, by, {of}).off[0];
    said = of.name +
           format(" = %.6g: %.2f mm is expected by the others: ", of.value / kMm, expected / kMm) +
           unit(of.value / expected, "typed wrong?") + " Measure it again, or " + kTakeOut;
  }
  return said.empty() && fabs(ratio - 1) > kFactor ? all + kChanged + ", or is a height wrong?"
                                                   : said;
}
}  // namespace truepose::printers
