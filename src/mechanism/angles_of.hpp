// Angles of the passive axes that bring the platform to a given position and orientation.
#pragma once

#include "math/square.hpp"
#include "mechanism/pose.hpp"

namespace truepose {
/// Maximum number of steps; each nearly doubles the number of digits.
inline constexpr int kAngleSteps = 20;

/// Finds the axis angles next to those of `pose` that bring the platform closest to `seen` (D, R),
/// by Newton's steps from there: least squares of the remaining D and turn times the rods' length.
void angles_of(const Robot& robot, const Pose& seen, Pose& pose);
}  // namespace truepose
