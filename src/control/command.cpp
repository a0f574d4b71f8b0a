#include "control/command.hpp"

namespace truepose {
Outcome same_full_mode(const Robot& robot, const Coordinates& x) {
  FullClosure closure;
  FullJacobians jacobians;
  Outcome outcome = ikm_full(robot, to_pose(robot.mobility, x), closure);
  if (outcome) outcome = jacobian_full(robot, closure, jacobians);
  if (outcome && full_detail::other_full_mode(robot, closure)) outcome = {Status::branch_lost, -1};
  return outcome;
}

Outcome command_full(const Robot& robot, const Coordinates& x, Joint& q) {
  const Outcome outcome = ikm_full(robot, x, q);
  if (!outcome) return outcome;
  return full_detail::with_full(
      robot, [&]() -> Outcome { return same_full_mode(robot, x); },
      [&] { return command(robot, x, q); });
}
}  // namespace truepose
