// Position and rate of a signal that is sampled once a cycle.
#pragma once

#include "math/real.hpp"

namespace truepose {
/// A tracking loop of second order (α-β filter) with both poles at `pole`, 0 to 1.
struct Tracker {
  Real value = 0, rate = 0;

  /// Prediction one period after the last correction.
  Real predicted(Real period) const { return value + period * rate; }

  /// @param innovation  reading minus prediction
  void correct(Real period, Real pole, Real innovation);
};

/// Gains from a reading to its innovation, h = ((1 - z⁻¹)/(1 - pole z⁻¹))²: Σh² for white noise,
/// the steady state for a constant second difference.
struct TrackerGains {
  Real variance = 0, acceleration = 0;
};

TrackerGains tracker_gains(Real pole);
}  // namespace truepose
