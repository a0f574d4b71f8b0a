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

/// Coordinates of a platform at D and R, its angles next to those of `near`. Where those are no
/// numbers, θ is next to 0, and the axes' angles next to home's.
Coordinates coordinates_of(const Robot& robot, const Pose& seen, const Coordinates& near);
}  // namespace truepose
