// Loop closure of one chain: from the motor to B, and from the platform to the motor.
#pragma once

#include <algorithm>
#include <numbers>

#include "truepose/model/pose.hpp"
#include "truepose/model/status.hpp"

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
inline Encoded encode(const Chain& chain, Real position) {
  // Beyond the turning point of the slide in v no v exists: the root is kept above zero.
  const Real root = std::sqrt(std::max(1 + 4 * chain.encoder_buildup * position, kTurningPoint));
  const Encoded read = encode(chain.eccentricity, 2 * position / (1 + root));
  return {chain.encoder_gain * read.value, chain.encoder_gain * read.slope / root};
}
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
  return 2 * std::fabs(difference) < std::fabs(turn) ? difference
                                                     : std::remainder(difference, turn);
}

/// Difference of a motor's readings without a revolute joint's whole turns, which are arbitrary.
inline Real within_turn(const Chain& chain, Real difference) {
  return chain.actuator == Actuator::revolute
             ? without_turns(difference, 2 * std::numbers::pi_v<Real> * chain.encoder_gain)
             : difference;
}
/// Point B relative to P, its derivative, and the rod's length, at motor position q.
struct Driven {
  Vec3 p, dB;
  Real rod;
  Real rate = 1;  ///< ∂position/∂q
};
inline Driven driven_point(const Chain& chain, Real q) {
  const Real position = motor_position(chain, q);
  const Real rate = chain.encoder_errs ? 1 / encode(chain, position).slope : 1;
  switch (chain.actuator) {
    case Actuator::prismatic:
      return {chain.axis * position, chain.axis * rate, chain.rod, rate};
    case Actuator::telescopic: return {Vec3::Zero(), Vec3::Zero(), position, rate};
    default: break;
  }
  const Vec3 e = chain.arm * chain.zero, w = chain.axis.cross(e);
  const Real c = std::cos(position), s = std::sin(position);
  return {c * e + s * w, rate * (c * w - s * e), chain.rod, rate};
}

/// Returns joint_limit and the first chain whose motor is beyond a stop.
inline Outcome beyond_limits(const Robot& robot, const Joint& q) {
  if (!robot.finished) return {Status::unfinished, -1};
  for (int i = 0; i < robot.motors; ++i) {
    const Real position = motor_position(robot.chain[i], q[i]);
    if (!(position >= robot.chain[i].low && position <= robot.chain[i].high))
      return {Status::joint_limit, i};
  }
  return {};
}

/// Checks all motors against their stops. Models of the robot's behaviour do not call it, as the
/// robot may be pushed there; commands (IKM, controllers) do.
/// @return joint_limit and the first chain beyond
inline Outcome within_limits(const Robot& robot, const Joint& q) {
  return robot.limited ? beyond_limits(robot, q) : Outcome{};
}

/// The same, including the limits of passive axes.
/// @return joint_limit: the first chain beyond, or -1 for an axis
inline Outcome within_limits(const Robot& robot, const Pose& pose,
                             const Joint& q) {
  for (int j = 0; j < passive_axes(robot.mobility) && robot.limited; ++j)
    if (!(pose.D[j] >= robot.axis[j].low && pose.D[j] <= robot.axis[j].high))
      return {Status::joint_limit, -1};
  return within_limits(robot, q);
}

/// The entry of J_q for a rod v: the paper's (p×v)·u, extended to any actuator.
inline Real jq_entry(const Chain& chain, const Vec3& v, const Driven& driven) {
  return chain.actuator == Actuator::telescopic ? -driven.rod * driven.rate : v.dot(driven.dB);
}

/// Length by which a rod is too short (positive) or too long (negative) to connect B's path, a
/// circle or a line, to A = P + d; 0 where the chain closes and for telescopic legs.
inline Real shortfall(const Chain& chain, const Vec3& d) {
  if (chain.actuator == Actuator::telescopic) return 0;
  const Real along = chain.axis.dot(d);
  const Real across = std::sqrt(std::max(d.squaredNorm() - along * along, 0.0));
  if (chain.actuator == Actuator::prismatic) return std::max(across - chain.rod, 0.0);
  const Real nearest = std::hypot(across - chain.arm, along);
  const Real farthest = std::hypot(across + chain.arm, along);
  return chain.rod < nearest ? nearest - chain.rod : std::min(farthest - chain.rod, 0.0);
}

/// Returns the reading, without the offset, of an encoder with errors, and converts derivatives to
/// that q. Not part of close(), whose usual path then costs nothing extra.
inline Real read_with_errors(const Chain& chain, Real position, ChainState& state) {
  const Encoded read = encode(chain, position);
  state.rate = 1 / read.slope;
  state.jq *= state.rate;
  state.dB *= state.rate;
  return read.value;
}

/// Closes a chain on A, d = A - P: two spheres (or sphere and line) meet in two points; the working
/// mode selects one. J_q's entry results as ± the root, without a division; no quotient by G, M or
/// N appears, and no arm position is special. @param angle  false: q is left out, the only
/// trigonometry
/// @return false where the rod cannot reach
inline bool close(const Chain& chain, const Vec3& d, bool angle, ChainState& state) {
  const Real sign = chain.working_mode, d2 = d.squaredNorm();
  Real position = 0;
  state.rate = 1;
  switch (chain.actuator) {
    case Actuator::telescopic: {
      position = std::sqrt(d2);
      state.p = state.dB = Vec3::Zero();
      state.jq = -position;
      if (!(position > 0 && position < INFINITY)) return false;
      if (chain.encoder_errs) position = read_with_errors(chain, position, state);
      break;
    }
    case Actuator::prismatic: {
      const Real along = chain.axis.dot(d);
      const Real root2 = chain.rod * chain.rod - d2 + along * along;
      if (!(root2 >= 0)) return false;
      state.jq = sign * std::sqrt(root2);
      position = along + state.jq;
      state.p = position * chain.axis;
      state.dB = chain.axis;
      if (chain.encoder_errs) position = read_with_errors(chain, position, state);
      break;
    }
    default: {  // a cos q + b sin q = c, from |p - d|² = L²
      const Vec3 e = chain.arm * chain.zero, w = chain.axis.cross(e);
      const Real a = e.dot(d), b = w.dot(d);
      const Real c = 0.5 * (chain.arm * chain.arm + d2 - chain.rod * chain.rod);
      const Real r2 = a * a + b * b, root2 = r2 - c * c;
      if (!(root2 >= 0) || !(r2 > 0)) return false;
      state.jq = sign * std::sqrt(root2);
      const Real cosine = (a * c - b * state.jq) / r2, sine = (b * c + a * state.jq) / r2;
      if (angle)  // tan(q/2) = sin/(1 + cos): half the cost, where regular
        position = cosine > -0.5 ? 2 * std::atan(sine / (1 + cosine)) : std::atan2(sine, cosine);
      state.p = cosine * e + sine * w;
      state.dB = cosine * w - sine * e;
      if (chain.encoder_errs) position = read_with_errors(chain, std::atan2(sine, cosine), state);
      break;
    }
  }
  state.q = position - chain.encoder_offset;
  state.v = state.p - d;
  return true;
}
}  // namespace truepose
