// Motor positions for a commanded pose: the inverse model with every check.
#pragma once

#include "mechanism/damping.hpp"
#include "mechanism/full.hpp"

namespace truepose {
/// q = IKM(x) for a command to the motors. The chains also close at poses of other assembly modes,
/// which the robot could reach only through a singular pose, where its motors no longer hold it:
/// these are refused (other_mode).
/// @param conditioning  out unless null: the smallest number of Conditioning
/// @return branch_lost: in another assembly mode; singular: between two; joint_limit and
/// unreachable as ikm
inline Outcome command(const Robot& robot, const Pose& pose, Joint& q,
                       Real* conditioning = nullptr) {
  Closure closure;
  Outcome outcome = ikm(robot, pose, closure);
  if (!outcome) return outcome;
  q = closure.q();
  outcome = within_limits(robot, pose, q);
  if (!outcome) return outcome;
  const Conditioning at(closure);
  outcome = at.outcome();
  if (outcome && other_mode(robot.assembly_sign, at.sign())) outcome = {Status::branch_lost, -1};
  if (outcome && conditioning) *conditioning = at.least();
  return outcome;
}

/// The same for coordinates x of any mobility.
inline Outcome command(const Robot& robot, const Coordinates& x, Joint& q) {
  return command(robot, to_pose(robot.mobility, x), q);
}

Outcome command_full(const Robot& robot, const Coordinates& x, Joint& q);
}  // namespace truepose
