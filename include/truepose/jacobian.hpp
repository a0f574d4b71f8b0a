// How do small motions of the nacelle and of the motors correspond? J_x ẋ = J_q q̇, ẋ = J q̇.
#pragma once

#include "truepose/ikm.hpp"
#include "truepose/square.hpp"

namespace truepose {

/// Row i of J_x: [vᵀ, (R c × v)ᵀ] S.
template <Mobility K>
inline void jx_row(const Vec3& v, const Vec3& lever, std::array<double, kDof<K>>& row) {
  if constexpr (kTurnsAboutZ<K>) {  // only the z component of the moment is free
    free_columns<K>(v, Vec3(0, 0, lever.x() * v.y() - lever.y() * v.x()), row.data());
  } else {
    free_columns<K>(v, lever.cross(v), row.data());
  }
}

/// |column|² of J_x if nothing cancelled: Σ|v|² for the columns of a velocity,
/// Σ|R c|²|v|² for those of a turn. Where the rods meet in one point the column of a turn vanishes:
/// small against this, not against itself.
template <Mobility K>
struct ColumnSizes {
  double velocity = 0, turn = 0;

  void add(const Vec3& v, const Vec3& lever) {
    const double v2 = v.squaredNorm();
    velocity += v2;
    turn += v2 * lever.squaredNorm();
  }
  std::array<double, kDof<K>> columns() const {
    std::array<double, kDof<K>> sizes;
    for (int j = 0; j < kDof<K>; ++j) sizes[j] = Freedom<K>::columns[j] < 3 ? velocity : turn;
    return sizes;
  }
};

template <Mobility K>
struct Jacobians {
  Matrix<kDof<K>, kDof<K>> jx, J;
  std::array<double, kDof<K>> jq;

  /// q̇ = J⁻¹ ẋ = J_q⁻¹ J_x ẋ, without inverting J.
  Joint joint_rate(const Joint& rate) const {
    Joint result{};
    for (int i = 0; i < kDof<K>; ++i) {
      double sum = 0;
      for (int j = 0; j < kDof<K>; ++j) sum += jx[i][j] * rate[j];
      result[i] = sum / jq[i];
    }
    return result;
  }
};

/// J_x, J_q and J = J_x⁻¹ J_q at a closed pose.
/// @return singular when J_x loses rank (type 2: the motors no longer hold the nacelle) or an
/// entry of J_q vanishes (type 1: an arm stretched or folded; `chain` says which).
template <Mobility K>
TRUEPOSE_FLATTEN inline Outcome jacobian(const Closure<K>& closure, Jacobians<K>& jacobians) {
  constexpr int n = kDof<K>;
  ColumnSizes<K> sizes;
  for (int i = 0; i < n; ++i) {
    const ChainState& chain = closure.chain[i];
    sizes.add(chain.v, chain.lever);
    jx_row<K>(chain.v, chain.lever, jacobians.jx[i]);
    jacobians.jq[i] = chain.jq;
    if (!(chain.jq * chain.jq > kSingular * chain.v.squaredNorm() * chain.dB.squaredNorm()))
      return {Status::singular, i};
  }
  const Square<n> square(jacobians.jx, sizes.columns());
  if (!square.regular()) return {Status::singular, -1};
  for (int j = 0; j < n; ++j) {
    const std::array<double, n> column = square.column(j, jacobians.jq[j]);
    for (int i = 0; i < n; ++i) jacobians.J[i][j] = column[i];
  }
  return {};
}

/// J(x), n×n, ẋ = J q̇; ẋ is a twist (its free columns), base frame.
inline Outcome jacobian(const Robot& robot, const Joint& x, JointMatrix& J) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Closure<K> closure;
    Outcome outcome = ikm<K, false>(robot, to_pose<K>(x), closure);
    Jacobians<K> jacobians;
    if (outcome) outcome = jacobian<K>(closure, jacobians);
    if (!outcome) return outcome;
    double sum = 0;
    for (int i = 0; i < kDof<K>; ++i)
      for (int j = 0; j < kDof<K>; ++j) sum += J[i][j] = jacobians.J[i][j];
    if (!std::isfinite(sum)) outcome = {Status::not_finite, -1};
    return outcome;
  });
}

/// Sign of det J_x: two poses with the same motors and another sign are other assembly modes.
template <Mobility K>
inline int assembly_sign(const Jacobians<K>& jacobians) {
  return determinant_sign<kDof<K>>(jacobians.jx);
}

/// Fills what a robot derives from its own data (assembly_sign, limited). Call once after building
/// it.
/// @return that of its home: unreachable, singular, joint_limit
inline Outcome finish(Robot& robot) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Closure<K> closure;
    Outcome outcome = ikm<K>(robot, to_pose<K>(robot.home), closure);
    Jacobians<K> jacobians;
    if (outcome) outcome = jacobian<K>(closure, jacobians);
    robot.assembly_sign = outcome ? assembly_sign<K>(jacobians) : 0;
    robot.limited = false;
    for (int i = 0; i < kDof<K>; ++i)
      robot.limited =
          robot.limited || std::isfinite(robot.chain[i].low) || std::isfinite(robot.chain[i].high);
    return outcome ? within_limits(robot, closure.q()) : outcome;
  });
}

}  // namespace truepose
