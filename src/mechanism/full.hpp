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

#include "mechanism/jacobian.hpp"

namespace truepose {
/// Pose of the platform with the motions that the ideal level excludes: R may tilt, bars may turn.
/// theta is atan2(R_10, R_00), whole turns included.
struct FullPose : Pose {
  std::array<Real, kMaxBars> psi{};
};

/// Full pose of an ideal pose.
FullPose to_full(const Pose& pose);

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
void complete_closure(const Robot& robot, FullClosure& at);

/// -∂f/∂(D, R, ψ) of one rod: [vᵀ, (lever × v)ᵀ, R e_z · (arm × v) for its own bar].
/// The motion is [velocity of D; angular velocity; ψ̇], base frame.
void full_row(const Robot& robot, const FullClosure& at, int rod,
              std::array<Real, kMaxUnknowns>& row);

/// θ̇ = t · ω for θ = atan2(R_10, R_00).
inline Vec3 theta_row(const Mat3& R) {
  const Real x = R(0, 0), y = R(1, 0), z = R(2, 0), h2 = x * x + y * y;
  return {-x * z / h2, -y * z / h2, 1};
}

/// Rank of a rows×columns matrix, its columns in units of their own size: elimination with full
/// pivoting, a pivot below 1e-6 counting as zero (kSingular is its square).
int rank(Matrix<kMaxRods, kMaxUnknowns> m, int rows, int columns);

/// The rods' rows at home, in full_row's columns; bars turned together by a four-bar share one.
/// @return the outcome of the inverse model at home
Outcome full_rows(const Robot& robot, bool together, Matrix<kMaxRods, kMaxUnknowns>& rows);

/// Whether the bars of an articulated platform turn together.
inline bool bars_together(const Robot& robot, int bars) {
  return robot.bar_joint == BarJoint::four_bar && bars > 1;
}

/// Removes from f the elongations that no freedom of the platform relieves: along `stress`. (AᵀA)⁻¹
/// of the freedoms' columns A projects on these; the remainder of a unit vector is along s.
void relax(const Robot& robot, FullClosure& at);

/// Computes the loops to close: f of all rods, or what relax leaves of it.
inline void open_loops(const Robot& robot, FullClosure& at) {
  complete_closure(robot, at);
  if (robot.full.kind == FullKind::elastic) relax(robot, at);
}

/// Determines whether a robot has a full level of its own, by the number of rods and freedoms and
/// the rods' rank at home. @return the outcome of the inverse model at home
Outcome full_level(const Robot& robot, FullLevel& level);

/// Fills robot.full. Call after finish(); costs the ideal level nothing.
/// @return the outcome of the inverse model at home
inline Outcome finish_full(Robot& robot) {
  return robot.finished ? full_level(robot, robot.full) : Outcome{Status::unfinished, -1};
}
}  // namespace truepose
