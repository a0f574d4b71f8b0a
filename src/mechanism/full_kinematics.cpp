#include "mechanism/full_kinematics.hpp"

namespace truepose::full_detail {
void free_row(const Robot& robot, const FullClosure& at, int rod,
              std::array<Real, kMaxUnknowns>& row) {
  full_row(robot, at, rod, row);
  if (robot.full.kind != FullKind::elastic) return;
  row[6] += row[7];
  row[7] = at.stress[rod];
}

void turn_bars(const Robot& robot, const Real* step, int count, FullPose& pose) {
  if (count == kMaxBars && robot.full.kind == FullKind::elastic) {
    for (Real& psi : pose.psi) psi += step[0];
  } else {
    for (int k = 0; k < count; ++k) pose.psi[k] += step[k];
  }
}

Real square_sum(const Robot& robot, const FullClosure& at, const std::array<Vec3, kMaxRods>& r) {
  Real sum = 0;
  for (int rod = 0; rod < rods_of(robot); ++rod)
    sum += at.v[rod].squaredNorm() * r[rod].squaredNorm();
  return sum;
}

void last_sizes(const Robot& robot, const FullClosure& at, int first, int turns, Unknowns& size) {
  std::fill_n(size.begin() + first, turns, square_sum(robot, at, at.lever));
  if (first + turns == rods_of(robot)) return;
  std::fill(size.begin() + first + turns, size.begin() + rods_of(robot),
            square_sum(robot, at, at.arm));
  if (robot.full.kind == FullKind::elastic)
    size.back() = sum_of(rods_of(robot), [&](int rod) { return at.stress[rod] * at.stress[rod]; });
}

}  // namespace truepose::full_detail

namespace truepose {
Parasitic beyond_ideal(const Robot& robot, const FullClosure& closure, const Pose& ideal,
                       const Joint& q) {
  Parasitic rest;
  rest.known = true;
  rest.tilt = closure.pose.R * ideal.R.transpose();
  for (int k = 0; k < kMaxBars; ++k) rest.turn[k] = closure.pose.psi[k] + ideal.theta;
  for (int i = 0; i < dof(robot.mobility); ++i) rest.q[i] = closure.q[i] - q[i];
  return rest;
}

Outcome jacobian_full(const Robot& robot, const FullClosure& closure, FullJacobians& jacobians) {
  const int n = dof(robot.mobility), N = rods_of(robot);
  for (int rod = 0; rod < N; ++rod)
    if (full_detail::stretched(closure, rod)) return {Status::singular, rod / 2};
  const full_detail::Factors factors(full_detail::Forward{robot}, closure, 0);
  if (!factors.regular()) return {Status::singular, -1};
  const Vec3 theta = theta_row(closure.pose.R);
  for (int j = 0; j < n; ++j) {  // column j: (AᵀA)⁻¹ Aᵀ Q e_j
    Unknowns of_motor{};
    for (const int rod : {2 * j, 2 * j + 1}) of_motor[rod] = closure.jq[rod];
    const Unknowns column = factors.square.solve(of_motor);
    for (int i = 0; i < N; ++i) jacobians.Z[i][j] = column[i];
    for (int i = 0; i < 3; ++i) jacobians.J[i][j] = column[i];
    if (turns_about_z(robot.mobility))
      jacobians.J[3][j] = theta.dot(Vec3(column[3], column[4], column[5]));
  }
  return {};
}

Outcome ikm_full(const Robot& robot, const Coordinates& x, Joint& q) {
  return full_detail::closed(
      robot, x,
      [&](const auto& closure) {
        q = closure.q;
        return within_limits(robot, q);
      },
      [&] { return ikm(robot, x, q); });
}

Outcome parasitic(const Robot& robot, const Coordinates& x, Coordinates& rest) {
  rest.fill(0);
  return full_detail::closed(
      robot, x,
      [&](const FullClosure& closure) {
        const Pose pose = to_pose(robot.mobility, x);
        const Vec3 tilt = log_so3(closure.pose.R * pose.R.transpose());
        const int tilts = full_detail::tilts_of(robot);
        for (int k = 0; k < tilts; ++k) rest[k] = tilt[k];
        for (int k = tilts; k < dof(robot.mobility); ++k)
          rest[k] = pose.theta + closure.pose.psi[k - tilts];
        return Outcome{};
      },
      [] { return Outcome{}; });
}

Outcome jacobian_full(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return full_detail::closed(
      robot, x,
      [&](const FullClosure& closure) {
        FullJacobians jacobians;
        const Outcome outcome = jacobian_full(robot, closure, jacobians);
        if (outcome)
          for (int i = 0; i < dof(robot.mobility); ++i)
            for (int j = 0; j < dof(robot.mobility); ++j) J[i][j] = jacobians.J[i][j];
        return outcome;
      },
      [&] { return jacobian(robot, x, J); });
}
}  // namespace truepose
