// Observer of the generalised momentum: external forces, and what causes them.
//
// For the momentum p = M(x) ẋ of the platform's coordinates (dynamics.hpp)
//
//     ṗ = Kᵀ (τ - friction) - c + Ṁ ẋ + f,
//
// f an external force. The observer filters its residual by (L/(s + L))², so no acceleration is
// needed: at the latest but one pose, M (v⁺ - v⁻)/T with the mean velocities of the periods before
// and after it is ṗ - Ṁ ẋ, and differences of noise telescope in the filter. Torques are those held
// in these periods. (De Luca, Albu-Schäffer, Haddadin and Hirzinger, Collision detection and safe
// reaction with the DLR-III lightweight manipulator arm, 2006, for serial robots.)
//
// The residual is kept in motor torques, ρ = Jᵀ f, where its σ is known: unknown friction, an error
// of torque and masses, counts. One unknown cause accounts for (ΣφᵀV⁻¹ρ)²/ΣφᵀV⁻¹φ of ΣρᵀV⁻¹ρ, φ its
// effect through the same filter: a mass at D, -Jᵀ (a_D - g), or friction of motor i, -sign(q̇_i),
// or of all. A cause that accounts for nearly all is named; otherwise it is a contact.
#pragma once

#include <algorithm>

#include "truepose/control/control.hpp"

namespace truepose {
/// Whether forces are observed: not with -DTRUEPOSE_NO_OBSERVER, for small machines.
#ifdef TRUEPOSE_NO_OBSERVER
inline constexpr bool kObserves = false;
#else
inline constexpr bool kObserves = true;
#endif

/// Cause of an external force.
enum class Disturbance : int {
  none = 0,
  payload = 1,   ///< a mass at D
  friction = 2,  ///< of one motor or of all alike, beyond the modelled one
  contact = 3,   ///< a force on the platform that is neither
};

/// Constant during a run. The defaults are assumed; a healthy robot stays below `alarm`.
struct MomentumSettings {
  Real period = 1e-3;   ///< s, of one or several control periods; 0: no observer
  Real bandwidth = 60;  ///< L, rad/s
  Real alarm = 25;      ///< χ² of the residual above which there is a disturbance
  Real share = 0.05;    ///< σ of masses and torques, as a share of the torque
  Real named = 0.85;    ///< share of the residual that a named cause accounts for
  Real kept = 0.6;      ///< the same for a cause that is already named
  Real window = 0.3;    ///< time constant with which older samples are forgotten, s
  Real over = 0.1;      ///< time below a quarter of `alarm` after which a disturbance is over, s
  Joint sigma{};        ///< σ of unknown friction and counts, N·m or N; 0: no observer
  Joint give{};         ///< error at which a motor's loop balances 1 N·m (N), rad or m
  bool carry = false;   ///< feeds an identified payload forward
};

/// Sums of the residual's regression on one cause.
struct Cause {
  Joint once{}, effect{};  ///< φ, filtered once and twice
  Real information = 0;    ///< Σ φᵀV⁻¹φ
  Real score = 0;          ///< Σ φᵀV⁻¹ρ
  Real energy = 0;         ///< of friction: Σ of that motor's share of ρᵀV⁻¹ρ
};

/// State and report. Plain data, the caller's; a new one starts afresh.
struct MomentumObserver {
  Disturbance disturbance = Disturbance::none;
  int motor = -1;        ///< of friction, from 0; -1: of all motors
  Real size = 0;         ///< kg, N·m (N) of friction, or the norm of the contact's force
  Real sigma = 0;        ///< of a payload or friction
  Coordinates force{};   ///< f, external force of the platform's coordinates, N and N·m
  Real chi2 = 0;         ///< of the residual
  bool refused = false;  ///< payload too heavy for the motors: it is not fed forward

  int cycles = 0;            ///< observed, saturated
  Pose pose;                 ///< the latest,
  Coordinates motion{};      ///< and the motion to it
  Joint torque{};            ///< applied before the latest
  Joint sum{};               ///< mean torque of the period so far,
  int waited = 0;            ///< and its control cycles
  Joint once{}, residual{};  ///< ρ, filtered once and twice
  Cause payload;
  std::array<Cause, kMaxMotors> friction;
  Real energy = 0;   ///< Σ ρᵀV⁻¹ρ
  Real count = 0;    ///< of samples in the sums
  int since = 0;     ///< cycles since the disturbance began; 0: none
  Real largest = 0;  ///< norm of the force since the disturbance began
  int quiet = 0;     ///< cycles below a quarter of `alarm`
};

namespace momentum_detail {
/// Two first-order low-passes. @param gain  L T
inline void filter(Real gain, const Joint& input, Joint& once, Joint& twice) {
  for (std::size_t i = 0; i < input.size(); ++i) {
    once[i] += gain * (input[i] - once[i]);
    twice[i] += gain * (once[i] - twice[i]);
  }
}

/// Motor torques for a mass of 1 kg at D. @param acceleration  ẍ
template <Mobility K>
inline Joint carried(const Robot& robot, const Closure<K>& closure, const DynamicModel<K>& model,
                     const Matrix<kDof<K>, kDof<K>>& J, const Coordinates& rate,
                     const Coordinates& acceleration) {
  constexpr int n = kDof<K>;
  const Twist twist = to_twist<K>(closure.carried, acceleration);
  const Vec3 force = twist.velocity + drifting<K>(closure.carried, rate).velocity - robot.gravity();
  std::array<Real, n> wrench;
  free_columns<K>(closure.carried, force, Vec3::Zero(), wrench.data());
  Joint torque{};
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) torque[i] += J[j][i] * wrench[j];
    torque[i] *= model.slope[i];
  }
  return torque;
}
}  // namespace momentum_detail

/// Runs one cycle. Bounded work; a failure changes nothing but the start.
/// @param pose    given by the believed motors
/// @param torque  applied since the last cycle
template <Mobility K>
inline Outcome observe_momentum(const Robot& robot, const MomentumSettings& settings,
                                const Pose& pose, const Joint& torque, MomentumObserver& state) {
  constexpr int n = kDof<K>;
  if (!kObserves || !(settings.period > 0 && settings.sigma[0] > 0)) return {};
  const Coordinates motion = state.cycles > 0 ? difference<K>(pose, state.pose) : Coordinates{};
  const Pose before = state.pose;
  const Coordinates last = state.motion;
  const Joint applied = state.torque;
  state.pose = pose;
  state.motion = motion;
  state.torque = torque;
  if (state.cycles < 2) {
    ++state.cycles;
    return {};
  }
  const Real per = 1 / settings.period;
  Coordinates rate{}, acceleration{};
  for (int i = 0; i < n; ++i) {
    rate[i] = 0.5 * per * (motion[i] + last[i]);
    acceleration[i] = per * per * (motion[i] - last[i]);
  }
  Closure<K> closure;
  Jacobians<K> jacobians;
  DynamicModel<K> model;
  Outcome outcome = ikm<K, false>(robot, before, closure);
  if (outcome) outcome = jacobian<K>(closure, jacobians);
  if (outcome) outcome = dynamic_model<K>(robot, closure, rate, model);
  Joint residual{};
  if (outcome) residual = inverse_dynamics<K>(model, jacobians.J, acceleration);
  for (int i = 0; i < n && outcome; ++i)
    residual[i] += friction(robot.chain[i], model.rate[i]) - 0.5 * (applied[i] + torque[i]);
  if (outcome && !all_finite(residual, n)) outcome = {Status::not_finite, -1};
  if (!outcome) {
    state.cycles = 0;
    return outcome;
  }

  const Real gain = std::min<Real>(1, settings.bandwidth * settings.period);
  momentum_detail::filter(gain, residual, state.once, state.residual);
  Joint mass = momentum_detail::carried<K>(robot, closure, model, jacobians.J, rate, acceleration);
  for (int i = 0; i < n; ++i) mass[i] = -mass[i];
  momentum_detail::filter(gain, mass, state.payload.once, state.payload.effect);
  Joint weight{};
  state.chi2 = 0;
  state.force = {};
  for (int i = 0; i < n; ++i) {
    // Within its counts a motor's direction is unknown.
    const Real slow = settings.period * settings.bandwidth * 0.1;
    Joint sign{};
    sign[i] = -std::clamp<Real>(model.rate[i] / slow, -1, 1);
    Cause& cause = state.friction[i];
    momentum_detail::filter(gain, sign, cause.once, cause.effect);
    const Real sigma = settings.sigma[i], share = settings.share * torque[i];
    weight[i] = 1 / (sigma * sigma + share * share);
    state.chi2 += state.residual[i] * state.residual[i] * weight[i];
    for (int j = 0; j < n; ++j) state.force[j] += model.k[i][j] * state.residual[i];
  }
  const auto product = [&](const Joint& a, const Joint& b) {
    Real sum = 0;
    for (int i = 0; i < n; ++i) sum += a[i] * weight[i] * b[i];
    return sum;
  };

  // From the start of a disturbance until it is over.
  constexpr int kLong = 1 << 30;  // cycles: a payload may be carried for months
  state.quiet = state.chi2 < settings.alarm / 4 ? std::min(state.quiet + 1, kLong) : 0;
  if (state.since == 0 ? state.chi2 < settings.alarm
                       : state.quiet * settings.period > settings.over) {
    if (state.since > 0) {
      state.payload.information = state.payload.score = 0;
      for (Cause& cause : state.friction) cause.information = cause.score = cause.energy = 0;
      state.energy = state.count = state.size = state.sigma = state.largest = 0;
      state.disturbance = Disturbance::none;
      state.motor = -1;
      state.since = 0;
    }
    return {};
  }
  constexpr Real kSettled = 4;  // time constants of the filter
  state.since = std::min(state.since + 1, kLong);
  Real square = 0;
  for (int i = 0; i < n; ++i) square += state.force[i] * state.force[i];
  state.largest = std::max(state.largest, std::sqrt(square));
  if (state.since * gain < kSettled) return {};
  const Real keep = 1 - settings.period / settings.window;
  const auto add = [&](Cause& cause) {
    cause.information = keep * cause.information + product(cause.effect, cause.effect);
    cause.score = keep * cause.score + product(cause.effect, state.residual);
  };
  add(state.payload);
  state.energy = keep * state.energy + product(state.residual, state.residual);
  state.count = keep * state.count + 1;
  // A mass and friction are not negative. A motor at rest may rub with less than its friction, in
  // either direction: all of its residual counts as friction's, as soon as any is against motion.
  const Real from_mass = state.payload.score > 0
                             ? state.payload.score * state.payload.score / state.payload.information
                             : 0;
  Real most = from_mass;
  int motor = -1;
  Cause every;  // friction of all motors
  for (int i = 0; i < n; ++i) {
    Cause& cause = state.friction[i];
    add(cause);
    cause.energy = keep * cause.energy + state.residual[i] * state.residual[i] * weight[i];
    if (cause.score > 0 && cause.energy > most) {
      most = cause.energy;
      motor = i;
    }
    every.information += cause.information;
    every.score += cause.score;
  }
  // The same friction of all motors, dry joints or cold grease, is one cause.
  const bool all = every.score > 0 && every.score * every.score > most * every.information;
  if (all) {
    most = every.score * every.score / every.information;
    motor = -1;
  }
  const bool payload = motor < 0 && !all;
  const Disturbance cause = payload ? Disturbance::payload : Disturbance::friction;
  const bool same = cause == state.disturbance && motor == state.motor;
  if (most > (same ? settings.kept : settings.named) * state.energy) {
    const Cause& of = payload ? state.payload : all ? every : state.friction[motor];
    state.disturbance = cause;
    state.motor = motor;
    state.size = of.score / of.information;
    // Errors of torque, masses and friction are systematic: more samples do not reduce them.
    state.sigma = std::sqrt(state.count / of.information);
  } else if (state.since * settings.period > settings.over + kSettled / settings.bandwidth) {
    state.disturbance = Disturbance::contact;
    state.motor = -1;
    state.size = state.largest;
    state.sigma = 0;
  }
  return {};
}

/// Adds the torques of an identified payload along the setpoint. If the motors cannot hold its
/// weight and the robot's, nothing is added and `refused` is set.
template <Mobility K>
inline void carry(const Robot& robot, const MomentumSettings& settings, const Setpoint& setpoint,
                  MomentumObserver& state, Joint& torque) {
  constexpr int n = kDof<K>;
  state.refused = false;
  if (!kObserves || !settings.carry || state.disturbance != Disturbance::payload) return;
  Closure<K> closure;
  Jacobians<K> jacobians;
  DynamicModel<K> model;
  Outcome outcome = ikm<K, false>(robot, to_pose<K>(setpoint.x), closure);
  if (outcome) outcome = jacobian<K>(closure, jacobians);
  if (outcome) outcome = dynamic_model<K>(robot, closure, Coordinates{}, model);
  if (!outcome) return;
  const Joint own = inverse_dynamics<K>(model, jacobians.J, Coordinates{});
  const Joint held =
      momentum_detail::carried<K>(robot, closure, model, jacobians.J, Coordinates{}, Coordinates{});
  const Joint more = momentum_detail::carried<K>(robot, closure, model, jacobians.J, setpoint.rate,
                                                 setpoint.acceleration);
  for (int i = 0; i < n; ++i) {
    const Real most = robot.chain[i].torque_limit;
    if (!std::isfinite(state.size * (std::fabs(held[i]) + std::fabs(more[i]))))
      state.refused = true;
    if (most > 0 && !(std::fabs(own[i] + state.size * held[i]) < most)) state.refused = true;
  }
  for (int i = 0; i < n && !state.refused; ++i)
    torque[i] = limited(robot.chain[i], torque[i] + state.size * more[i]);
}
}  // namespace truepose
