// Loop closure of one chain: from the motor to B, and from the platform to the motor.
#pragma once

#include "mechanism/pose.hpp"
#include "truepose/status.hpp"

namespace truepose {
/// A chain whose loop is closed.
struct ChainState {
  Real q = 0;   ///< motor position as the encoder reads it
  Real rate;    ///< ∂position/∂q: 1 without gain, eccentricity and build-up of the encoder
  Vec3 p;       ///< P to B (telescopic: zero)
  Vec3 v;       ///< A to B, the rod
  Vec3 lever;   ///< R c, from D to the platform point
  Vec3 dB;      ///< ∂B/∂q
  Real jq = 0;  ///< the chain's entry of J_q: v·∂B/∂q (telescopic: -L)
};

/// Lower limit of 1 + 4 β φ for a slide φ.
inline constexpr Real kTurningPoint = Real(1e-6);

/// Encoder reading without offset, gain (v + e(v)), and its derivative at a motor angle or slide. A
/// spool of radius r that winds in layers, t per turn, has wound r φ + t φ²/4π after φ: a slide is
/// v + β v², v = r φ, β = t/(4π r²).
Encoded encode(const Chain& chain, Real position);
/// Inverse of encode.
inline Real decode(const Chain& chain, Real value) {
  const Real v = decode(chain.eccentricity, value / chain.encoder_gain);
  return v + chain.encoder_buildup * v * v;
}

/// Motor position that its stops refer to, from the reading: angle or slide without encoder errors.
inline Real motor_position(const Chain& chain, Real q) {
  const Real value = q + chain.encoder_offset;
  return chain.encoder_errs ? decode(chain, value) : value;
}

/// Encoder reading at a motor angle or slide, the inverse of motor_position.
inline Real motor_reading(const Chain& chain, Real position) {
  return (chain.encoder_errs ? encode(chain, position).value : position) - chain.encoder_offset;
}

/// std::remainder by a whole turn, with a fast path within half a turn, the usual case.
inline Real without_turns(Real difference, Real turn) {
  return 2 * fabs(difference) < fabs(turn) ? difference : remainder(difference, turn);
}

/// Difference of a motor's readings without a revolute joint's whole turns, which are arbitrary.
Real within_turn(const Chain& chain, Real difference);
/// Point B relative to P, its derivative, and the rod's length, at motor position q.
struct Driven {
  Vec3 p, dB;
  Real rod;
  Real rate = 1;  ///< ∂position/∂q
};
Driven driven_point(const Chain& chain, Real q);

/// Returns joint_limit and the first chain whose motor is beyond a stop.
Outcome beyond_limits(const Robot& robot, const Joint& q);

/// Checks all motors against their stops. Models of the robot's behaviour do not call it, as the
/// robot may be pushed there; commands (IKM, controllers) do.
/// @return joint_limit and the first chain beyond
inline Outcome within_limits(const Robot& robot, const Joint& q) {
  return robot.limited ? beyond_limits(robot, q) : Outcome{};
}

/// The same, including the limits of passive axes.
/// @return joint_limit: the first chain beyond, or -1 for an axis
Outcome within_limits(const Robot& robot, const Pose& pose, const Joint& q);

/// The entry of J_q for a rod v: the paper's (p×v)·u, extended to any actuator.
inline Real jq_entry(const Chain& chain, const Vec3& v, const Driven& driven) {
  return chain.actuator == Actuator::telescopic ? -driven.rod * driven.rate : v.dot(driven.dB);
}

/// Length by which a rod is too short (positive) or too long (negative) to connect B's path, a
/// circle or a line, to A = P + d; 0 where the chain closes and for telescopic legs.
Real shortfall(const Chain& chain, const Vec3& d);

/// Closes a chain on A, d = A - P: two spheres (or sphere and line) meet in two points; the working
/// mode selects one. J_q's entry results as ± the root, without a division; no quotient by G, M or
/// N appears, and no arm position is special. @param angle  false: q is left out, the only
/// trigonometry
/// @return false where the rod cannot reach
bool close(const Chain& chain, const Vec3& d, bool angle, ChainState& state);
}  // namespace truepose
