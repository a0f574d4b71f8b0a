// Values and derivatives of all readings at the full level.
#include "mechanism/full_linearise.hpp"

namespace truepose {
Outcome linearise_full(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                       Real* H_xi, Parasitic* rest) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (robot.full.kind == FullKind::same) return linearise(robot, pose, q_e, H_x, H_xi);
  if (!robot.full.own()) return {Status::no_full_level, -1};
  FullClosure closure;
  const Outcome outcome = ikm_full(robot, pose, closure, rest);
  if (!outcome) return outcome;
  return linearise(robot, closure.built, closure.at, closure.pose.theta, q_e, H_x, H_xi);
}
}  // namespace truepose
