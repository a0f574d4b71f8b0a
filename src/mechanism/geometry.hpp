// The robot for given values of ξ.
#pragma once

#include "mechanism/parameters.hpp"

namespace truepose {
/// Writes ξ, parameter_count(drawn) values from which set_parameters makes the robot again.
Outcome drawn_parameters(const Robot& drawn, Real* xi);

/// Overwrites everything in `robot` that ξ determines.
/// @param drawn  nominal robot, axes at zero yaw and tilt
/// @param xi     parameter_count(drawn) values, in the order of parameters.hpp; directions and
///               normals of any length
/// @param robot  in: a copy of `drawn`, whatever its parameters; out: with these parameters
Outcome set_parameters(const Robot& drawn, const Real* xi, Robot& robot);
}  // namespace truepose
