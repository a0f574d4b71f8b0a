// Values and derivatives of all readings at a pose: q_e = [q; r], H_x = ∂q_e/∂x, H_ξ = ∂q_e/∂ξ.
#include "estimation/linearise.hpp"

namespace truepose {
void pose_rows(const Robot& robot, const Jacobians& jacobians, const SensorRows& jr,
               PoseRows& H_x) {
  const int n = dof(robot.mobility), m = robot.motors;
  for (int i : range(m))
    for (int j : range(n)) H_x[i][j] = jacobians.jx[i][j] / jacobians.jq[i];
  for (int k : range(robot.r)) H_x[m + k] = jr[k];
}

namespace {
Outcome linearise(const Robot& robot, const Closure& closure, Extended& q_e, PoseRows& H_x,
                  Real* H_xi) {
  const int n = dof(robot.mobility);
  Jacobians jacobians;
  Reading values;
  SensorRows jr;
  Outcome outcome = jacobian(closure, jacobians);
  if (outcome) outcome = rkm(robot, closure, values, jr);
  if (!outcome) return outcome;
  extend(robot, closure.q(), values, q_e);
  pose_rows(robot, jacobians, jr, H_x);
  Real sum = 0;  // a NaN shows in it
  for (int c : range(readings(robot)))
    for (int j : range(n)) sum += H_x[c][j];
  if (H_xi) {
    parameter_jacobian(robot, closure, H_xi);
    const Real* end = H_xi + readings(robot) * parameter_count(robot);
    for (const Real* entry = H_xi; entry != end; ++entry) sum += *entry;
  }
  if (!isfinite(sum)) outcome = {Status::not_finite};
  return outcome;
}
Outcome linearise(const Robot& robot, const FullClosure& closure, Extended& q_e, PoseRows& H_x,
                  Real* H_xi) {
  return truepose::linearise(robot, closure.built, closure.at, closure.pose.theta, q_e, H_x, H_xi);
}
}  // namespace

Outcome linearise(Level level, const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                  Real* H_xi, Parasitic* rest) {
  const auto of = [&](const auto& at) { return linearise(robot, at, q_e, H_x, H_xi); };
  return closed(level, robot, pose, of, rest);
}
}  // namespace truepose
