// Steps of the motors as the cause of readings that fit no printer, or not the file's parameters.
#pragma once

#include "truepose/printers/fit.hpp"

namespace truepose::printers {
constexpr double kUnfit = 1 * kMm;
constexpr double kRival = 0.3;  ///< rms under other steps over that under the file's: not worse

/// Step distances of one motor or of all, wrong by a factor, that leave less than `most`: an
/// explanation of readings that no printer fits with its own; empty if there is none. `first` 3:
/// of all alone.
inline string wrong_steps(const Printer& printer, const Config& config, const Assumed& assumed,
                          double arm, double most = HUGE_VAL, int first = 0) {
  double least = min(most, 0.2 * kMm);
  string said;
  for (int i = first; i <= 3; ++i)
    for (const double factor : {0.25, 0.5, 2.0 / 3, 0.8, 1.25, 1.5, 2.0, 4.0}) {
      Printer other = printer;
      for (int motor = 0; motor < 3; ++motor)
        if (i == 3 || i == motor) other.delta.step[motor] /= factor;
      const Prior known = prior(other, config, assumed, arm);
      const Estimate found = estimate(other.delta, other.readings, known, assumed);
      const double left = rms(errors(other.delta, found.theta, other.readings).off);
      if (!(left < least)) continue;
      least = left;
      said = i == 3 ? string("all motors: their") : format("stepper_%c: its", "abc"[i]);
      said += format(
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
  Vector off = errors(printer.delta, printer.theta, printer.readings).off;
  if (rms(off) < kUnfit) return {};
  auto heights = off.head(heights_of(printer.readings));
  heights.array() -= heights.mean();
  const double own = isfinite(rms(off)) ? rms(off) : HUGE_VAL;
  const auto left = [&](double power) {
    Delta former = printer.delta;
    former.step *= pow(kGrid, power);
    const double value = rms(errors(former, printer.theta, printer.readings).off);
    return isfinite(value) ? value : HUGE_VAL;
  };
  double at = 0;
  for (int k = -kMost; k <= kMost; ++k)
    if (left(k) < left(at)) at = k;
  for (double step = 0.5; step > 1e-6; step *= 0.5)
    at += left(at - step) < left(at) ? -step : left(at + step) < left(at) ? step : 0;
  const double least = left(at);
  if (!(least < min(kClear * own, kRival * kUnfit))) return {};
  return format(
      "the steps of all motors are %.3g times as long as in these readings: with the "
      "former ones the file's parameters leave %s mm rms; %s?",
      pow(kGrid, -at), shown_mm(least).c_str(), kChanged);
}
}  // namespace truepose::printers
