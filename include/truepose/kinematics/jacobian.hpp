// Jacobians between motions of platform and motors: J_x ẋ = J_q q̇, ẋ = J q̇.
#pragma once

#include "truepose/kinematics/ikm.hpp"
#include "truepose/math/square.hpp"

namespace truepose {
/// Row i of J_x along the platform's free twists: [vᵀ, (R c × v)ᵀ] S, or a_j·((A - p_j) × v) for a
/// passive axis. Given Points, all rows at once: `row` then holds the columns.
template <Mobility K, class Vector, class Row>
inline void jx_row([[maybe_unused]] const Carried<K>& carried, const Vector& v, const Vector& lever,
                   Row& row) {
  if constexpr (kRotational<K>) {
    const auto mx = lever.y() * v.z() - lever.z() * v.y();
    const auto my = lever.z() * v.x() - lever.x() * v.z();
    const auto mz = lever.x() * v.y() - lever.y() * v.x();
    for (int j = 0; j < kDof<K>; ++j) {
      const Vec3 &l = carried.linear[j], &a = carried.axis[j];
      row[j] = l.x() * v.x() + l.y() * v.y() + l.z() * v.z() + a.x() * mx + a.y() * my + a.z() * mz;
    }
  } else {
    for (int j = 0; j < kDof<K>; ++j) switch (Freedom<K>::columns[j]) {
        case 0: row[j] = v.x(); break;
        case 1: row[j] = v.y(); break;
        case 2: row[j] = v.z(); break;
        case 3: row[j] = lever.y() * v.z() - lever.z() * v.y(); break;
        case 4: row[j] = lever.z() * v.x() - lever.x() * v.z(); break;
        default: row[j] = lever.x() * v.y() - lever.y() * v.x(); break;
      }
  }
}

/// |column|² of J_x if nothing cancelled: Σ|v|² for columns of a velocity, Σ|R c|²|v|² for those of
/// a turn, Σ|A - p_j|²|v|² for a passive axis. Where the rods meet in one point, the column of a
/// turn vanishes relative to this size.
template <Mobility K>
inline std::array<Real, kDof<K>> column_sizes([[maybe_unused]] const Carried<K>& carried,
                                              const Lanes<kDof<K>>& v2,
                                              const Points<kDof<K>>& lever) {
  std::array<Real, kDof<K>> sizes;
  if constexpr (kRotational<K>) {
    for (int j = 0; j < kDof<K>; ++j) {
      const Vec3& arm = carried.arm[j];
      const Points<kDof<K>> from{lever.px + arm.x(), lever.py + arm.y(), lever.pz + arm.z()};
      sizes[j] = (v2 * from.squared_norm()).sum();
    }
  } else {
    const Real velocity = v2.sum(), turn = (v2 * lever.squared_norm()).sum();
    for (int j = 0; j < kDof<K>; ++j) sizes[j] = Freedom<K>::columns[j] < 3 ? velocity : turn;
  }
  return sizes;
}

/// J_x, the diagonal of J_q, and J = J_x⁻¹ J_q at a closed pose.
template <Mobility K>
struct Jacobians {
  Matrix<kDof<K>, kDof<K>> jx, J;
  std::array<Real, kDof<K>> jq;
  Real determinant = 0;  ///< of J_x, or a number of its sign
  /// Sign of det J_x. Poses with equal q and different sign are in different assembly modes.
  int sign() const { return (determinant > 0) - (determinant < 0); }

  /// q̇ = J⁻¹ ẋ = J_q⁻¹ J_x ẋ, without an inverse of J.
  Joint joint_rate(const Coordinates& rate) const {
    Joint result{};
    for (int i = 0; i < kDof<K>; ++i) {
      Real sum = 0;
      for (int j = 0; j < kDof<K>; ++j) sum += jx[i][j] * rate[j];
      result[i] = sum / jq[i];
    }
    return result;
  }
};

/// Computes J_x, J_q and J = J_x⁻¹ J_q at a closed pose.
/// @return singular where J_x loses rank (type 2: the motors do not hold the platform) or an entry
/// of J_q vanishes (type 1: the arm of `chain` is stretched or folded).
template <Mobility K>
TRUEPOSE_FLATTEN inline Outcome jacobian(const Closure<K>& closure, Jacobians<K>& jacobians) {
  constexpr int n = kDof<K>;
  const auto& chain = closure.chain;
  const Points<n> v = points<n>([&](int i) -> const Vec3& { return chain[i].v; });
  const Points<n> lever = points<n>([&](int i) -> const Vec3& { return chain[i].lever; });
  const Lanes<n> jq = lanes<n>([&](int i) { return chain[i].jq; });
  const Lanes<n> v2 = v.squared_norm();
  const Lanes<n> dB2 = points<n>([&](int i) -> const Vec3& { return chain[i].dB; }).squared_norm();
  if (!all_positive<n>(jq * jq - kSingular * v2 * dB2))
    for (int i = 0; i < n; ++i)
      if (!(jq[i] * jq[i] > kSingular * v2[i] * dB2[i])) return {Status::singular, i};
  Eigen::Map<Lanes<n>>(jacobians.jq.data()) = jq;
  std::array<Lanes<n>, n> columns;
  jx_row<K>(closure.carried, v, lever, columns);
  jacobians.jx = rows_of<n>(columns);
  const auto sizes = column_sizes<K>(closure.carried, v2, lever);
  const Inverted inverse = invert<n>(columns, sizes, jq, 0, jacobians.J);
  jacobians.determinant = inverse.determinant;
  return {inverse ? Status::ok : Status::singular, -1};
}

/// Computes J(x), n×n, ẋ = J q̇; ẋ is a twist (its free columns), base frame.
inline Outcome jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return with_mobility(robot.mobility, [&]<Mobility K>(Fixed<K>) {
    Closure<K> closure;
    Outcome outcome = ikm<K, false>(robot, to_pose<K>(x), closure);
    Jacobians<K> jacobians;
    if (outcome) outcome = jacobian<K>(closure, jacobians);
    if (!outcome) return outcome;
    Lanes<kDof<K>> sum = Lanes<kDof<K>>::Zero();  // becomes NaN if any value is
    for (int i = 0; i < kDof<K>; ++i) {
      const Eigen::Map<const Lanes<kDof<K>>> row(jacobians.J[i].data());
      sum += row;
      Eigen::Map<Lanes<kDof<K>>>(J[i].data()) = row;
    }
    if (!std::isfinite(sum.sum())) outcome = {Status::not_finite, -1};
    return outcome;
  });
}

/// Whether a determinant's sign differs from that at home, which proves another assembly mode. An
/// equal sign proves nothing: a robot may have two regions of one sign.
/// @param home  sign at home; 0: not checked
/// @param sign  sign(): that of the determinant, -1, 0 (between two modes) or 1
template <class Sign>
inline bool other_mode(int home, Sign&& sign) {
  return home != 0 && sign() != home;
}
template <Mobility K>
inline bool other_mode(const Robot& robot, const Jacobians<K>& jacobians) {
  return other_mode(robot.assembly_sign, [&] { return jacobians.sign(); });
}

/// Derives assembly_sign from the present geometry; unchanged where home is out of its reach.
/// @return the outcome at home: unreachable, singular, joint_limit
inline Outcome note_assembly(Robot& robot) {
  return with_mobility(robot.mobility, [&]<Mobility K>(Fixed<K>) {
    Closure<K> closure;
    Outcome outcome = ikm<K>(robot, to_pose<K>(robot.home), closure);
    Jacobians<K> jacobians;
    if (outcome) outcome = jacobian<K>(closure, jacobians);
    if (outcome) robot.assembly_sign = jacobians.sign();
    return outcome ? within_limits<K>(robot, closure.pose, closure.q()) : outcome;
  });
}

/// Checks a robot's counts, indices and enums, and derives assembly_sign, limited, encoder_errs and
/// the inclinometers' vertical. Call it after building a robot and after every change.
/// A robot with a singular or unreachable home is finished, too: its assembly mode is unchecked.
/// @return no_such_part, not_compiled, not_square: refused, still unfinished; or the outcome at
/// home: unreachable, singular, joint_limit
inline Outcome finish(Robot& robot) {
  robot.finished = false;
  const Outcome exist = parts_exist(robot);
  if (!exist) return exist;
  if (!compiled(robot.mobility) || (!kFullLevel && robot.level == Level::full))
    return {Status::not_compiled, -1};
  const int n = dof(robot.mobility);
  if (robot.chains != n || robot.motors != n) return {Status::not_square, -1};
  robot.finished = true;
  note_encoders(robot);
  note_vertical(robot);
  robot.limited = false;
  robot.assembly_sign = 0;
  for (int i = 0; i < robot.motors; ++i)
    robot.limited =
        robot.limited || std::isfinite(robot.chain[i].low) || std::isfinite(robot.chain[i].high);
  for (int j = 0; j < passive_axes(robot.mobility); ++j)
    robot.limited =
        robot.limited || std::isfinite(robot.axis[j].low) || std::isfinite(robot.axis[j].high);
  return note_assembly(robot);
}
}  // namespace truepose
