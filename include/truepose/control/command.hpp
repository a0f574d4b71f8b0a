// Motor positions for a commanded pose: the inverse model with every check.
#pragma once

#include "truepose/full/kinematics.hpp"
#include "truepose/kinematics/damping.hpp"

namespace truepose {
/// branch_lost if the determinant of all rods' rows has another sign than at home.
template <Mobility K>
inline Outcome same_full_mode(const Robot& robot, const Coordinates& x) {
  FullClosure<K> closure;
  FullJacobians<K> jacobians;
  Outcome outcome = ikm_full<K>(robot, to_pose<K>(x), closure);
  if (outcome) outcome = jacobian_full<K>(robot, closure, jacobians);
  if (outcome && full_detail::other_full_mode<K>(robot, closure))
    outcome = {Status::branch_lost, -1};
  return outcome;
}

/// q = IKM(x) for a command to the motors. The chains also close at poses of other assembly modes,
/// which the robot could reach only through a singular pose, where its motors no longer hold it:
/// these are refused (other_mode).
/// @param conditioning  out unless null: the smallest number of Conditioning
/// @return branch_lost: in another assembly mode; singular: between two; joint_limit and
/// unreachable as ikm
template <Mobility K>
TRUEPOSE_FLATTEN inline Outcome command(const Robot& robot, const Pose& pose, Joint& q,
                                        Real* conditioning = nullptr) {
  Closure<K> closure;
  Outcome outcome = ikm<K>(robot, pose, closure);
  if (!outcome) return outcome;
  q = closure.q();
  outcome = within_limits<K>(robot, pose, q);
  if (!outcome) return outcome;
  const Conditioning<K> at(closure);
  outcome = at.outcome();
  if (outcome && other_mode(robot.assembly_sign, [&] { return at.sign(); }))
    outcome = {Status::branch_lost, -1};
  if (outcome && conditioning) *conditioning = at.least();
  return outcome;
}

/// The same for coordinates x of any mobility.
inline Outcome command(const Robot& robot, const Coordinates& x, Joint& q) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    return command<mobility()>(robot, to_pose<mobility()>(x), q);
  });
}

inline Outcome command_full(const Robot& robot, const Coordinates& x, Joint& q) {
  const Outcome outcome = ikm_full(robot, x, q);
  if (!outcome) return outcome;
  return full_detail::with_full(
      robot, [&](auto mobility) -> Outcome { return same_full_mode<mobility()>(robot, x); },
      [&] { return command(robot, x, q); });
}
}  // namespace truepose
