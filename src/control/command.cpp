// Motor positions for a commanded pose: the inverse model with every check.
#include "control/command.hpp"

namespace truepose {
namespace {
Outcome regular(const Robot& robot, const Pose&, const Closure& closure, Real* conditioning) {
  const Conditioning at(closure);
  const Outcome outcome = at.outcome();
  if (outcome && other_mode(robot.assembly_sign, at.sign())) return {Status::branch_lost};
  if (outcome && conditioning) *conditioning = at.least();
  return outcome;
}
Outcome regular(const Robot& robot, const Pose& pose, const FullClosure& closure,
                Real* conditioning) {
  JointMatrix J;
  Outcome outcome = jacobian(robot, closure, J);
  const engine::Mechanism& m = closure.built.mechanism;
  if (outcome && other_mode(m.sign, engine::mode_of(m, closure.at))) return {Status::branch_lost};
  Closure ideal;
  if (outcome && conditioning) outcome = ikm(robot, pose, ideal);
  if (outcome && conditioning) *conditioning = Conditioning(ideal).least();
  return outcome;
}
}  // namespace

Outcome command(Level level, const Robot& robot, const Pose& pose, Joint& q, Real* conditioning) {
  return closed(level, robot, pose, [&](const auto& at) {
    q = at.q();
    const Outcome outcome = within_limits(robot, at.pose, q);
    return outcome ? regular(robot, pose, at, conditioning) : outcome;
  });
}
}  // namespace truepose
