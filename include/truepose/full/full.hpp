// The full level of the model: every rod by itself, platform bodies that tilt, bars that turn.
//
// Unknowns are D, R in SO(3) and one angle ψ_k per lateral bar, whose orientation is R R_z(ψ_k).
// The two rods of chain i, ±, join
//
//     B_i ± (s/2) u_i     and     A_i± = D + R c_i + R_bar (a_i ± (s/2) u_i⁰),   R_bar = R R_z(ψ_k)
//
// with u_i turning with the motor's axis (yaw and tilt; on a carriage the rods' own direction) and
// the nominal u_i⁰ fixed in the bar, or in the platform where there is no bar (R_bar = R). The
// ideal level is R = R_z(θ), ψ_k = -θ.
//
// With one rod too many (8 for the 7 freedoms of a Par4's rigid four-bar platform) the loops close
// only by chance. Rods are then springs of equal stiffness, and the mechanism takes the pose of
// least energy ½kΣδ² in their elongations δ = f/L. There Σ δ ∂δ/∂z = 0 along every freedom z, so
// that with D = diag(L) the closures are f = λ D²s, s normal to all columns of ∂f/∂z: again as many
// equations as unknowns, the stress λ included.
#pragma once

#include "truepose/kinematics/jacobian.hpp"

namespace truepose {
/// Pose of the platform with the motions that the ideal level excludes: R may tilt, bars may turn.
/// theta is atan2(R_10, R_00), whole turns included.
struct FullPose : Pose {
  std::array<Real, kMaxBars> psi{};
};

/// Full pose of an ideal pose.
inline FullPose to_full(const Pose& pose) {
  FullPose full{pose};
  full.psi.fill(-pose.theta);
  return full;
}

/// Residual motion: the full pose against the ideal one. It changes slowly with the pose: a
/// solution nearby starts from it.
struct Parasitic {
  bool known = false;
  Mat3 tilt = Mat3::Identity();       ///< of the platform, base frame
  std::array<Real, kMaxBars> turn{};  ///< of every bar, against the base
  Joint q{};                          ///< of the motors

  FullPose beside(const Pose& pose) const {
    FullPose full = to_full(pose);
    full.R = tilt * pose.R;
    for (int k = 0; k < kMaxBars; ++k) full.psi[k] += turn[k];
    return full;
  }
};

/// Rods of a robot whose every chain is a spatial parallelogram; the size of its full level.
inline int rods_of(const Robot& robot) { return 2 * dof(robot.mobility); }

/// Whether a mobility needs spatial parallelograms: single rods could not hold the orientation.
constexpr bool paired(Mobility mobility) {
  return mobility == Mobility::translation || mobility == Mobility::schoenflies;
}

/// From rod - to rod + at the base-side joint, unit: along a motor's axis, across a carriage's rail
/// (rods one above the other on upright rails would leave the platform free to turn about z).
inline Vec3 pair_direction(const Chain& chain) {
  return chain.actuator == Actuator::prismatic ? chain.pair_axis : chain.axis;
}

/// All rods at one full pose, closed or not. Rod 2i is chain i's +, rod 2i + 1 its -.
struct FullClosure {
  FullPose pose;
  Joint q{};
  std::array<Driven, kMaxDof> driven;
  std::array<Vec3, kMaxRods> v;         ///< A to B
  std::array<Vec3, kMaxRods> lever;     ///< D to A
  std::array<Vec3, kMaxRods> arm;       ///< pivot to A: turns with the bar
  std::array<Real, kMaxRods> f;         ///< (|v|² - L²)/2
  std::array<Real, kMaxRods> jq;        ///< ∂f/∂q
  std::array<Real, kMaxRods> stress{};  ///< FullKind::elastic: D²s, removed from f
  Real cost = 0;                        ///< Σf²
  Real residual = 0;                    ///< largest | |v| - L |, m
};

/// Length of one rod of a pair, side = ±1.
inline Real rod_length(const Chain& chain, const Driven& driven, Real side) {
  return driven.rod + 0.5 * side * chain.rod_difference;
}

/// Fills everything in `at` that follows from its pose and its driven points.
inline void complete_closure(const Robot& robot, FullClosure& at) {
  std::array<Mat3, kMaxBars> bar;
  for (int k = 0; k < kMaxBars; ++k) bar[k] = at.pose.R * rotation_z(at.pose.psi[k]);
  at.cost = at.residual = 0;
  for (int i = 0; i < dof(robot.mobility); ++i) {
    const Chain& chain = robot.chain[i];
    const Driven& driven = at.driven[i];
    const Mat3& R = chain.bar < 0 ? at.pose.R : bar[chain.bar];
    const Vec3 pivot = at.pose.R * chain.pivot, arm = R * chain.anchor;
    const Vec3 half_A = R * (0.5 * chain.rod_spacing * chain.pair_drawn);
    const Vec3 half_B = 0.5 * chain.rod_spacing * pair_direction(chain);
    const Vec3 middle = chain.base + driven.p - at.pose.D - pivot - arm;
    for (int rod = 2 * i; rod < 2 * i + 2; ++rod) {
      const Real side = rod == 2 * i ? 1 : -1;
      const Real length = rod_length(chain, driven, side);
      at.arm[rod] = arm + side * half_A;
      at.lever[rod] = pivot + at.arm[rod];
      at.v[rod] = middle + side * (half_B - half_A);
      at.f[rod] = 0.5 * (at.v[rod].squaredNorm() - length * length);
      // u is the axis about which B turns (or keeps its direction): ∂B/∂q is the chain's.
      at.jq[rod] =
          chain.actuator == Actuator::telescopic ? -length * driven.rate : at.v[rod].dot(driven.dB);
      at.cost += at.f[rod] * at.f[rod];
      at.residual = std::max(at.residual, std::fabs(at.f[rod]) / length);
    }
  }
}

/// -∂f/∂(D, R, ψ) of one rod: [vᵀ, (lever × v)ᵀ, R e_z · (arm × v) for its own bar].
/// The motion is [velocity of D; angular velocity; ψ̇], base frame.
inline void full_row(const Robot& robot, const FullClosure& at, int rod,
                     std::array<Real, kMaxUnknowns>& row) {
  const Vec3 moment = at.lever[rod].cross(at.v[rod]);
  for (int k = 0; k < 3; ++k) {
    row[k] = at.v[rod][k];
    row[3 + k] = moment[k];
  }
  row[6] = row[7] = 0;
  const int bar = robot.chain[rod / 2].bar;
  if (bar >= 0) row[6 + bar] = at.pose.R.col(2).dot(at.arm[rod].cross(at.v[rod]));
}

/// θ̇ = t · ω for θ = atan2(R_10, R_00).
inline Vec3 theta_row(const Mat3& R) {
  const Real x = R(0, 0), y = R(1, 0), z = R(2, 0), h2 = x * x + y * y;
  return {-x * z / h2, -y * z / h2, 1};
}

/// Rank of a rows×columns matrix, its columns in units of their own size: elimination with full
/// pivoting, a pivot below 1e-6 counting as zero (kSingular is its square).
inline int rank(Matrix<kMaxRods, kMaxUnknowns> m, int rows, int columns) {
  for (int j = 0; j < columns; ++j) {
    Real size = 0;
    for (int i = 0; i < rows; ++i) size = std::max(size, std::fabs(m[i][j]));
    for (int i = 0; i < rows && size > 0; ++i) m[i][j] /= size;
  }
  for (int k = 0; k < std::min(rows, columns); ++k) {
    int row = k, column = k;
    for (int i = k; i < rows; ++i)
      for (int j = k; j < columns; ++j)
        if (std::fabs(m[i][j]) > std::fabs(m[row][column])) row = i, column = j;
    if (!(std::fabs(m[row][column]) > 1e-6)) return k;
    std::swap(m[k], m[row]);
    for (int i = 0; i < rows; ++i) std::swap(m[i][k], m[i][column]);
    for (int i = k + 1; i < rows; ++i) {
      const Real factor = m[i][k] / m[k][k];
      for (int j = k; j < columns; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  return std::min(rows, columns);
}

/// The rods' rows at home, in full_row's columns; bars turned together by a four-bar share one.
/// @return the outcome of the inverse model at home
inline Outcome full_rows(const Robot& robot, bool together, Matrix<kMaxRods, kMaxUnknowns>& rows) {
  Closure ideal;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, robot.home), ideal);
  if (!outcome) return outcome;
  FullClosure at;
  at.pose = to_full(ideal.pose);
  for (int i = 0; i < dof(robot.mobility); ++i) at.driven[i] = driven_point(robot.chain[i], ideal.chain[i].q);
  complete_closure(robot, at);
  for (int rod = 0; rod < rods_of(robot); ++rod) {
    full_row(robot, at, rod, rows[rod]);
    if (together) rows[rod][6] += rows[rod][7];
  }
  return outcome;
}

/// Whether the bars of an articulated platform turn together.
inline bool bars_together(const Robot& robot, int bars) {
  return robot.bar_joint == BarJoint::four_bar && bars > 1;
}

/// Removes from f the elongations that no freedom of the platform relieves: along `stress`. (AᵀA)⁻¹
/// of the freedoms' columns A projects on these; the remainder of a unit vector is along s.
inline void relax(const Robot& robot, FullClosure& at) {
  constexpr int N = kMaxUnknowns, m = N - 1;
  Square A, normal{};
  Unknowns size;
  for (int rod = 0; rod < N; ++rod) {
    std::array<Real, kMaxUnknowns> row;
    full_row(robot, at, rod, row);
    row[6] += row[7];
    std::copy_n(row.begin(), m, A[rod].begin());
    for (int i = 0; i < m; ++i)
      for (int j = 0; j <= i; ++j) normal[i][j] += A[rod][i] * A[rod][j];
  }
  for (int i = 0; i < m; ++i) size[i] = normal[i][i];
  const Ldlt factor(m, normal, size);
  std::array<Real, N> s{};
  for (int k = 0; k < N; ++k) {  // s_k² is at least 1/N for one of them
    Unknowns x = A[k];
    factor.solve(x);
    for (int rod = 0; rod < N; ++rod) {
      s[rod] = rod == k;
      for (int j = 0; j < m; ++j) s[rod] -= A[rod][j] * x[j];
    }
    if (s[k] > 0.5 / N) break;
  }
  Real held = 0, unit = 0;  // sᵀf and sᵀD²s
  for (int rod = 0; rod < N; ++rod) {
    const Real length = at.driven[rod / 2].rod;
    at.stress[rod] = length * length * s[rod];
    held += s[rod] * at.f[rod];
    unit += s[rod] * at.stress[rod];
  }
  at.cost = at.residual = 0;
  for (int rod = 0; rod < N; ++rod) {
    at.f[rod] -= held / unit * at.stress[rod];
    at.cost += at.f[rod] * at.f[rod];
    at.residual = std::max(at.residual, std::fabs(at.f[rod]) / at.driven[rod / 2].rod);
  }
}

/// Computes the loops to close: f of all rods, or what relax leaves of it.
inline void open_loops(const Robot& robot, FullClosure& at) {
  complete_closure(robot, at);
  if (robot.full.kind == FullKind::elastic) relax(robot, at);
}

/// Determines whether a robot has a full level of its own, by the number of rods and freedoms and
/// the rods' rank at home. @return the outcome of the inverse model at home
inline Outcome full_level(const Robot& robot, FullLevel& level) {
  const int n = dof(robot.mobility);
  level = {};
  bool described = true;
  for (int i = 0; i < n; ++i) {
    level.bars = std::max(level.bars, robot.chain[i].bar + 1);
    described = described && robot.chain[i].rod_spacing > 0;
  }
  if (!paired(robot.mobility)) {
    level.kind = FullKind::same;
    level.rods = level.unknowns = n;
    return {};
  } else {
    if (!described || level.bars > kMaxBars) return {};
    const bool together = bars_together(robot, level.bars);
    level.rods = rods_of(robot);
    level.unknowns = 6 + (together ? 1 : level.bars);
    if (level.unknowns > level.rods) {
      level.kind = FullKind::loose;
      level.excess = level.unknowns - level.rods;
      return {};
    }
    Matrix<kMaxRods, kMaxUnknowns> rows{};
    const Outcome outcome = full_rows(robot, together, rows);
    if (!outcome) return outcome;
    const int held = rank(rows, level.rods, level.unknowns);
    if (held < level.unknowns) {
      level.kind = FullKind::loose;
      level.excess = level.unknowns - held;
    } else if (level.rods > level.unknowns) {
      level.excess = level.rods - level.unknowns;
      const bool relieved = level.excess == 1 && level.rods == kMaxUnknowns;
      level.kind = relieved ? FullKind::elastic : FullKind::overconstrained;
    } else {
      level.kind = FullKind::exists;
      Square square;
      std::copy_n(rows.begin(), level.rods, square.begin());
      level.sign = determinant_sign(level.rods, square);
    }
    return {};
  }
}

/// Fills robot.full. Call after finish(); costs the ideal level nothing.
/// @return the outcome of the inverse model at home
inline Outcome finish_full(Robot& robot) {
  return robot.finished ? full_level(robot, robot.full) : Outcome{Status::unfinished, -1};
}
}  // namespace truepose
