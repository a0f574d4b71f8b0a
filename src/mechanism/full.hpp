// The full level of the model: every rod by itself, a platform that tilts, bars that turn.
//
// The two rods of chain i, ±, join
//
//     B_i ± (s/2) u_i     and     A_i± = D + R c_i + R_bar (a_i ± (s/2) u_i⁰),   R_bar = R R_z(ψ_k)
//
// with u_i turning with the motor's axis (yaw and tilt; on a carriage the rods' own direction) and
// the nominal u_i⁰ fixed in the bar, or in the platform where there is no bar (R_bar = R). The
// ideal level is R = R_z(θ), ψ_k = -θ. With one rod too many (8 for the 7 freedoms of a Par4's
// rigid four-bar platform) the rods are springs of equal stiffness (engine::Mechanism::elastic).
#pragma once

#include "mechanism/rkm.hpp"
#include "mechanism/sense_mechanism.hpp"

namespace truepose {
/// Pose of the platform with the motions that the ideal level excludes: R may tilt, bars may turn.
/// theta is atan2(R_10, R_00), whole turns included.
struct FullPose : Pose {
  std::array<Real, kMaxBars> psi{};
};

/// Full pose of an ideal pose.
FullPose to_full(const Pose& pose);

inline constexpr int kUncounted = 1 << 30;
inline constexpr int kClosing = 2;      ///< a closing costs as much as so many of its Newton steps
inline constexpr int kNearClosing = 5;  ///< Newton steps that suffice from a solution nearby,
inline constexpr int kFarClosing = 10;  ///< and from the ideal level, where steps are counted

/// Steps that the closings of a control cycle may take (Parasitic): paths of the H4 take 12. A
/// search for x̂ that has none left goes on in the next cycle.
inline constexpr int kCycleSteps = 16;
/// Those of a robot: a described mechanism's closings, which start at its home, are not counted.
constexpr int cycle_steps(const Robot& robot) {
  return is_mechanism(robot.mobility) ? kUncounted : kCycleSteps;
}

/// Residual motion: the full level's freedoms against the ideal ones at the same pose. It changes
/// slowly with the pose: a solution nearby starts from it.
struct Parasitic {
  bool known = false;
  engine::Row y{};
  int left = kUncounted;  ///< steps that closings may still take: a closing two, and its Newton's

  /// Newton steps of a closing. @param near  it starts at a solution nearby
  int most(bool near) const {
    return left == kUncounted ? kFkmCap : min(left - kClosing, near ? kNearClosing : kFarClosing);
  }
  void take(int steps) { left -= left == kUncounted ? 0 : kClosing + steps; }
};

/// A robot in one position, all rods closed or not. Rod 2i is chain i's +, rod 2i + 1 its -.
struct FullClosure {
  FullClosure() = default;  // no aggregate: braces are coordinates
  Built built;
  engine::Position at;
  FullPose pose;
  Joint motors{};

  const Joint& q() const { return motors; }
  /// Notes the residual motion. @param ideal  freedoms of the ideal level at the same pose
  void note(const engine::Row& ideal, Parasitic& rest) const;
};

/// Whether a mobility needs spatial parallelograms: single rods could not hold the orientation.
constexpr bool paired(Mobility mobility) {
  return mobility == Mobility::translation || mobility == Mobility::schoenflies;
}

/// Closes a described mechanism at home; notes the freedoms there, and its assembly mode.
/// @return the outcome at home, as of note_assembly
Outcome note_home(Robot& robot);

/// Fills robot.full: whether the robot has a full level of its own, by the number of rods and
/// freedoms and the rods' rank at home. Call after finish(); costs the ideal level nothing.
/// @return the outcome of the inverse model at home
Outcome finish_full(Robot& robot);

/// The rods at home with the platform free: derivatives along its motion [velocity of D; angular
/// velocity] and its bars' turns. @return the outcome of the inverse model at home
Outcome full_rows(const Robot& robot, std::array<engine::Row, engine::kClosures>& rows);

/// x = FKM(q), all rods closed. The full level must be its own. Starts at D and θ of the guess.
/// @param pose  in: the guess; out: D, R, ψ (the last iterate if not ok)
/// @param rest  residual motion at a pose nearby
FkmResult fkm(const Robot& robot, const Joint& q, FullPose& pose, FullClosure& closure,
              int cap = kFkmCap, const Parasitic& rest = {});

/// Motor positions, tilt and bars' turns that hold D and θ (of a translation robot: D), all rods
/// closed. Starts at the ideal inverse model.
/// @param rest  in: residual motion at a pose nearby; out: at this one, if ok
/// @return also not_converged where no steps are left
FkmResult ikm(const Robot& robot, const Pose& pose, FullClosure& closure,
              Parasitic* rest = nullptr);

/// J at a closed position, ẋ = J q̇.
/// @return singular when the rods' rows lose rank, or (with the chain) an arm is stretched;
/// not_finite: an encoder's errors, say
Outcome jacobian(const Robot& robot, const FullClosure& closure, JointMatrix& J);

/// Readings of a mechanism in any position, its loops closed or not. With backlash or compliant
/// arms the motors' encoders see one angle and the rods' joints another.
/// @param motor, arm  angles or slides before the encoders' offsets
Outcome read_standing(const Robot& robot, const FullPose& pose, const Joint& motor,
                      const Joint& arm, Extended& q_e);
}  // namespace truepose
