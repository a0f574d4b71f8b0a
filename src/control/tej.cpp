// The extended-to-joint matrix (TEJ), which corrects motor errors by redundant readings.
#include "control/tej.hpp"

namespace truepose {
void tej(const Robot& robot, const Jacobians& jacobians, const SensorRows& jr, ExtendedColumns& M,
         ExtendedRows& M_plus) {
  const int n = dof(robot.mobility), m = robot.motors;
  for (int j : range(m)) {
    Joint column{};
    if (m > n) {
      Coordinates rate;
      for (int i : range(n)) rate[i] = jacobians.J[i][j];
      column = jacobians.joint_rate(rate);
    } else {
      column[j] = 1;
    }
    for (int i : range(m)) M[i][j] = M_plus[i][j] = column[i];
  }
  for (int s : range(robot.r)) {
    const Real weight = robot.sensor[s].weight;
    Joint g, gain;
    for (int j : range(m))
      M[m + s][j] = g[j] = sum_of(n, [&](int i) { return jr[s][i] * jacobians.J[i][j]; });
    for (int i : range(m)) gain[i] = sum_of(m, [&](int j) { return M_plus[i][j] * g[j]; });
    const Real gCg = sum_of(m, [&](int i) { return g[i] * gain[i]; });
    const Real scale = weight / (1 + weight * gCg);
    for (int i : range(m)) gain[i] *= scale;
    for (int c : range(m + s)) {
      const Real seen = sum_of(m, [&](int i) { return g[i] * M_plus[i][c]; });  // g M⁺, entry c
      for (int i : range(m)) M_plus[i][c] -= gain[i] * seen;
    }
    for (int i : range(m)) M_plus[i][m + s] = gain[i];
  }
}

namespace {
/// J and J_r of a described mechanism: K and J_r are its H_x.
Outcome by_rows(const Robot& robot, const Pose& pose, Closure& closure, Jacobians& jacobians,
                Reading& r, SensorRows& jr, Parasitic* rest) {
  const int n = jacobians.n = dof(robot.mobility), m = jacobians.motors = robot.motors;
  Extended q_e;
  PoseRows H_x;
  FullClosure at;
  Outcome outcome = ikm(robot, pose, at, rest);
  if (outcome) outcome = linearise(robot, at.built, at.at, 0, q_e, H_x, nullptr);
  if (!outcome) return outcome;
  closure.pose = pose;
  closure.motors = m;
  Unknowns size{};
  for (int i : range(m)) {
    closure.chain[i].q = q_e[i];
    jacobians.jq[i] = 1;
    for (int j : range(n)) {
      jacobians.jx[i][j] = H_x[i][j];
      size[j] += H_x[i][j] * H_x[i][j];
    }
  }
  for (int k : range(robot.r)) r[k] = q_e[m + k], jr[k] = H_x[m + k];
  jacobians.sign = engine::mode_of(at.built.mechanism, at.at);
  return {invert(m, n, jacobians.jx, size, jacobians.J) ? Status::ok : Status::singular};
}
}  // namespace

Outcome kinematics_at(const Robot& robot, const Pose& pose, Real band, Closure& closure,
                      Jacobians& jacobians, Reading& r, SensorRows& jr, Parasitic* rest) {
  if (is_mechanism(robot.mobility)) return by_rows(robot, pose, closure, jacobians, r, jr, rest);
  Outcome outcome = ikm(robot, pose, closure);
  if (outcome) outcome = jacobian(closure, band, jacobians);
  const Outcome regular = outcome;
  if (outcome) outcome = rkm(robot, closure, r, jr);
  return outcome ? regular : outcome;
}

Outcome tej(const Robot& robot, const Coordinates& x, ExtendedColumns& M, ExtendedRows& M_plus,
            Real band) {
  Closure closure;
  Jacobians jacobians;
  Reading values;
  SensorRows jr;
  const Outcome regular =
      kinematics_at(robot, to_pose(robot.mobility, x), band, closure, jacobians, values, jr);
  if (!regular) return regular;
  tej(robot, jacobians, jr, M, M_plus);
  Real sum = 0;  // of each sensor's row and column: a row that overflowed leaves a column of 0
  for (int c : range(robot.motors, readings(robot)))
    for (int i : range(robot.motors)) sum += M[c][i] + M_plus[i][c];
  return isfinite(sum) ? regular : Outcome{Status::not_finite};
}
}  // namespace truepose
