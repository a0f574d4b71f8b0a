// Position and rate of a signal that is sampled once a cycle.
#pragma once

#include "truepose/math/real.hpp"

namespace truepose {
/// A tracking loop of second order (α-β filter) with both poles at `pole`, 0 to 1.
struct Tracker {
  Real value = 0, rate = 0;

  /// Prediction one period after the last correction.
  Real predicted(Real period) const { return value + period * rate; }

  /// @param innovation  reading minus prediction
  void correct(Real period, Real pole, Real innovation) {
    value += period * rate + (1 - pole * pole) * innovation;
    rate += (1 - pole) * (1 - pole) / period * innovation;
  }
};

/// Gains from a reading to its innovation, h = ((1 - z⁻¹)/(1 - pole z⁻¹))²: Σh² for white noise,
/// Σ|h| for bounded errors such as counts, the steady state for a constant second difference.
struct TrackerGains {
  Real variance = 0, largest = 0, acceleration = 0;
};

inline TrackerGains tracker_gains(Real pole) {
  TrackerGains gains;
  gains.acceleration = 1 / ((1 - pole) * (1 - pole));
  // impulse response: (1 - pole z⁻¹)² h = (1 - z⁻¹)², until it has decayed
  Real before = 0, last = 0;
  for (int k = 0; k < 1000; ++k) {
    const Real input = k == 0 ? 1 : k == 1 ? -2 : k == 2 ? 1 : 0;
    const Real h = input + 2 * pole * last - pole * pole * before;
    gains.variance += h * h;
    gains.largest += h < 0 ? -h : h;
    before = last;
    last = h;
  }
  return gains;
}
}  // namespace truepose
