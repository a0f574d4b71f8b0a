// Setpoints along a quintic time law.
#pragma once

#include "mechanism/pose.hpp"

namespace truepose {
/// Desired pose, free twist and its derivative.
struct Setpoint {
  Coordinates x{}, rate{}, acceleration{};
};

/// The setpoint at u, 0 to 1, of the way between two that are `duration` seconds apart: quintic
/// Hermite polynomials meet both positions, rates and accelerations. Rotations turn about one fixed
/// axis.
Setpoint between(Mobility mobility, const Setpoint& from, const Setpoint& to, Real duration,
                 Real u);

/// Quintic move from `from` to `to` in `duration` seconds, at rest at both ends, constant outside:
/// s = 10u³ - 15u⁴ + 6u⁵, with zero velocity and acceleration at the ends. The twist is exactly s'
/// times a constant.
inline Setpoint quintic(Mobility mobility, const Coordinates& from, const Coordinates& to,
                        Real duration, Real time) {
  return between(mobility, {from}, {to}, duration, clamp<Real>(time / duration, 0, 1));
}
}  // namespace truepose
