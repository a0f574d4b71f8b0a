// A straight move with a quintic time law.
#pragma once

#include <algorithm>

#include "mechanism/pose.hpp"

namespace truepose {
/// Desired pose, free twist and its derivative.
struct Setpoint {
  Coordinates x{}, rate{}, acceleration{};
};

/// Quintic move from `from` to `to` in `duration` seconds, at rest at both ends, constant outside:
/// s = 10u³ - 15u⁴ + 6u⁵, with zero velocity and acceleration at the ends. Rotations turn about one
/// fixed axis, so the twist is exactly s' times a constant.
Setpoint quintic(Mobility mobility, const Coordinates& from, const Coordinates& to, Real duration,
                 Real time);
}  // namespace truepose
