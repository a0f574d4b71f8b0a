// Motor positions for a commanded pose: the inverse model with every check.
#pragma once

#include "truepose/full/kinematics.hpp"

namespace truepose {

namespace command_detail {

/// branch_lost where det J_x has not the sign that it has at home.
template <Mobility K>
inline Outcome same_mode(const Robot& robot, const Coordinates& x) {
  Closure<K> closure;
  Jacobians<K> jacobians;
  Outcome outcome = ikm<K, false>(robot, to_pose<K>(x), closure);
  if (outcome) outcome = jacobian<K>(closure, jacobians);
  if (outcome && other_mode<K>(robot, jacobians)) outcome = {Status::branch_lost, -1};
  return outcome;
}

/// The same of the rows of every rod by itself.
template <Mobility K>
inline Outcome same_full_mode(const Robot& robot, const Coordinates& x) {
  FullClosure<K> closure;
  const FullResult result = ikm_full<K>(robot, to_pose<K>(x), closure);
  FullJacobians<K> jacobians;
  if (!result) return {result.status, result.chain};
  const Outcome outcome = jacobian_full<K>(robot, closure, jacobians);
  if (!outcome) return outcome;
  full_detail::Rows<K> A;
  full_detail::Forward<K>{robot}.columns(closure, A);
  if (other_mode(robot.full.sign, [&] { return determinant_sign<kRods<K>>(A); }))
    return {Status::branch_lost, -1};
  return outcome;
}

}  // namespace command_detail

/// q = IKM(x) for motors that will go there. The chains alone close on poses of any assembly mode,
/// also on those that the robot could only reach through a singular pose, where its motors no
/// longer hold it: they are refused (other_mode).
///
/// @return branch_lost: in another assembly mode; singular: between two; joint_limit and
/// unreachable as of ikm
inline Outcome command(const Robot& robot, const Coordinates& x, Joint& q) {
  const Outcome outcome = ikm(robot, x, q);
  if (!outcome) return outcome;
  return with_mobility(robot.mobility, [&](auto mobility) {
    return command_detail::same_mode<mobility()>(robot, x);
  });
}

/// The same at the full level.
inline Outcome command_full(const Robot& robot, const Coordinates& x, Joint& q) {
  const Outcome outcome = ikm_full(robot, x, q);
  if (!outcome) return outcome;
  return full_detail::with_full(
      robot,
      [&](auto mobility) -> Outcome {
        return command_detail::same_full_mode<mobility()>(robot, x);
      },
      [&] { return command(robot, x, q); });
}

}  // namespace truepose
