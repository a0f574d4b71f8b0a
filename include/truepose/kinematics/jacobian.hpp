// Jacobians between motions of platform and motors: J_x ẋ = J_q q̇, ẋ = J q̇.
#pragma once

#include "truepose/kinematics/ikm.hpp"
#include "truepose/math/square.hpp"

namespace truepose {
/// A row of J_x along the platform's free twists: [vᵀ, (R c × v)ᵀ] S, or a_j·((A - p_j) × v) for a
/// passive axis.
inline void jx_row(const Carried& carried, const Vec3& v, const Vec3& lever, Real* row) {
  free_row(carried, v, lever.cross(v), row);
}

/// |column|² of J_x if nothing cancelled: Σ|v|² for columns of a velocity, Σ|R c|²|v|² for those of
/// a turn, Σ|A - p_j|²|v|² for a passive axis. Where the rods meet in one point, the column of a
/// turn vanishes relative to this size. @param v2  |v|² of every chain
inline Unknowns column_sizes(const Carried& carried, const Joint& v2,
                             const std::array<Vec3, kMaxChains>& lever) {
  const int n = carried.n;
  Unknowns sizes;
  if (is_rotational(carried.mobility)) {
    for (int j = 0; j < n; ++j)
      sizes[j] =
          sum_of(n, [&](int i) { return v2[i] * (lever[i] + carried.arm[j]).squaredNorm(); });
  } else {
    const Real velocity = sum_of(n, [&](int i) { return v2[i]; });
    const Real turn = sum_of(n, [&](int i) { return v2[i] * lever[i].squaredNorm(); });
    for (int j = 0; j < n; ++j) sizes[j] = free_columns(carried.mobility)[j] < 3 ? velocity : turn;
  }
  return sizes;
}

/// J_x, the diagonal of J_q, and J = J_x⁻¹ J_q at a closed pose.
struct Jacobians {
  int n;
  Square jx, J;
  Joint jq;
  int sign = 0;  ///< of det J_x: poses with equal q and different sign are in different assembly modes

  /// q̇ = J⁻¹ ẋ = J_q⁻¹ J_x ẋ, without an inverse of J.
  Joint joint_rate(const Coordinates& rate) const {
    Joint result{};
    for (int i = 0; i < n; ++i)
      result[i] = sum_of(n, [&](int j) { return jx[i][j] * rate[j]; }) / jq[i];
    return result;
  }
};

/// Computes J_x, J_q and J = J_x⁻¹ J_q at a closed pose.
/// @return singular where J_x loses rank (type 2: the motors do not hold the platform) or an entry
/// of J_q vanishes (type 1: the arm of `chain` is stretched or folded).
inline Outcome jacobian(const Closure& closure, Jacobians& jacobians) {
  const Carried& carried = closure.carried;
  const int n = jacobians.n = carried.n;
  std::array<Vec3, kMaxChains> lever;
  Joint v2;
  for (int i = 0; i < n; ++i) {
    const ChainState& chain = closure.chain[i];
    lever[i] = chain.lever;
    v2[i] = chain.v.squaredNorm();
    jacobians.jq[i] = chain.jq;
    if (!(chain.jq * chain.jq > kSingular * v2[i] * chain.dB.squaredNorm()))
      return {Status::singular, i};
    jx_row(carried, chain.v, chain.lever, jacobians.jx[i].data());
  }
  const Inverted inverse =
      invert(n, jacobians.jx, column_sizes(carried, v2, lever), 0, jacobians.J);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) jacobians.J[i][j] *= jacobians.jq[j];
  jacobians.sign = inverse.sign;
  return {inverse ? Status::ok : Status::singular, -1};
}

/// Computes J(x), n×n, ẋ = J q̇; ẋ is a twist (its free columns), base frame.
inline Outcome jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  Closure closure;
  Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure, false);
  Jacobians jacobians;
  if (outcome) outcome = jacobian(closure, jacobians);
  if (!outcome) return outcome;
  Real sum = 0;  // becomes NaN if any value is
  for (int i = 0; i < jacobians.n; ++i)
    for (int j = 0; j < jacobians.n; ++j) sum += J[i][j] = jacobians.J[i][j];
  return {std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}

/// Whether a determinant's sign differs from that at home, which proves another assembly mode. An
/// equal sign proves nothing: a robot may have two regions of one sign.
/// @param home  sign at home; 0: not checked
/// @param sign  -1, 0 (between two modes) or 1
constexpr bool other_mode(int home, int sign) { return home != 0 && sign != home; }

/// Derives assembly_sign from the present geometry; unchanged where home is out of its reach.
/// @return the outcome at home: unreachable, singular, joint_limit
inline Outcome note_assembly(Robot& robot) {
  Closure closure;
  Outcome outcome = ikm(robot, to_pose(robot.mobility, robot.home), closure);
  Jacobians jacobians;
  if (outcome) outcome = jacobian(closure, jacobians);
  if (outcome) robot.assembly_sign = jacobians.sign;
  return outcome ? within_limits(robot, closure.pose, closure.q()) : outcome;
}

/// Checks a robot's counts, indices and enums, and derives assembly_sign, limited, encoder_errs and
/// the inclinometers' vertical. Call it after building a robot and after every change.
/// A robot with a singular or unreachable home is finished, too: its assembly mode is unchecked.
/// @return no_such_part, not_square: refused, still unfinished; or the outcome at home:
/// unreachable, singular, joint_limit
inline Outcome finish(Robot& robot) {
  robot.finished = false;
  const Outcome exist = parts_exist(robot);
  if (!exist) return exist;
  const int n = dof(robot.mobility);
  if (robot.chains != n || robot.motors != n) return {Status::not_square, -1};
  robot.finished = true;
  note_encoders(robot);
  note_vertical(robot);
  robot.limited = false;
  robot.assembly_sign = 0;
  const auto limits = [&](const auto& of) {
    robot.limited = robot.limited || std::isfinite(of.low) || std::isfinite(of.high);
  };
  for (int i = 0; i < robot.motors; ++i) limits(robot.chain[i]);
  for (int j = 0; j < passive_axes(robot.mobility); ++j) limits(robot.axis[j]);
  return note_assembly(robot);
}
}  // namespace truepose
