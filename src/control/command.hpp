// Motor positions for a commanded pose: the inverse model with every check.
#pragma once

#include "mechanism/damping.hpp"
#include "mechanism/levels.hpp"

namespace truepose {
/// q = IKM(x) for a command to the motors. The chains also close at poses of other assembly modes,
/// which the robot could reach only through a singular pose, where its motors no longer hold it:
/// these are refused (other_mode).
/// @param conditioning  out unless null: the smallest number of the ideal level's Conditioning
/// @return branch_lost: in another assembly mode; singular: between two; joint_limit and
/// unreachable as ikm
Outcome command(Level level, const Robot& robot, const Pose& pose, Joint& q,
                Real* conditioning = nullptr);

/// The same for coordinates x of any mobility.
inline Outcome command(Level level, const Robot& robot, const Coordinates& x, Joint& q) {
  return command(level, robot, to_pose(robot.mobility, x), q);
}
}  // namespace truepose
