// One control cycle: readings and setpoint in, motor torques out.
#pragma once

#include <algorithm>

#include "truepose/control/dynamics.hpp"
#include "truepose/control/law.hpp"
#include "truepose/control/trajectory.hpp"

namespace truepose {

enum class FeedForward : int {
  none = 0,
  gravity = 1,  ///< holds the nominal robot at x_d
  full = 2,     ///< gravity, inertia and Coriolis of the nominal robot along the trajectory
};

/// What kp, kd and ki mean.
enum class Gains : int {
  diagonal = 0,  ///< torques, each motor's of its own error alone: N·m/rad (N/m) and so on
  inertia = 1,   ///< accelerations, 1/s², 1/s and 1/s³, that the joint inertia turns into torques
};

/// Constant during a run.
struct ControlSettings {
  Law law = Law::joint;
  /// Times every reading's own σ, in the weights of laws that weigh. A calibration leaves errors
  /// that nearly cancel in the readings; the best weights for what it leaves multiply readings'
  /// differences, hence also what arms and drives do to them. Larger σ, smaller multiples.
  int sigma_scale = 1;
  Gains gains = Gains::diagonal;
  FeedForward feed_forward = FeedForward::full;
  Real period = 1e-3;              ///< s
  Real velocity_bandwidth = 1500;  ///< of the velocity tracking loops, rad/s
  Real damped_below = 0;           ///< conditioning from which on J is damped (0: never)
  Real lead_out = 0.2;             ///< s over which a switch of law or readings takes effect
  Joint kp{};                      ///< N·m/rad (N/m), or 1/s²
  Joint kd{};                      ///< N·m·s/rad, or 1/s
  Joint ki{};                      ///< N·m/(rad·s), or 1/s³; 0: no integral action
};

/// What a controller remembers from cycle to cycle. Zero it to switch the controller on.
struct ControlState {
  bool started = false;
  Extended position{};    ///< the tracking loops: of the readings, or of x̂
  Extended rate{};        ///< theirs: of the desired less that, rates of the error
  Extended desired{};     ///< rate of the desired at the last cycle
  Joint integral{};       ///< N·m
  Joint torque{};         ///< the last one commanded; held when a cycle fails
  Joint error{};          ///< ê_q of the last good cycle
  Joint error_rate{};     ///< its rate, as found
  Joint q_d{};            ///< desired readings of the motors a period later, as far as is known
  Joint load{};           ///< N·m, what of the torque answers no error
  Parasitic nearby;       ///< of a robot that is understood rod by rod, at x_d
  Law law = Law::joint;   ///< whose terms `position` and `rate` are in
  bool switched = false;  ///< set where readings are replaced by others: no step follows
  Joint held{};           ///< by how much ê_q was larger before the last switch than after it,
  Real leaving = 0;       ///< led out in so many seconds more
  /// Motors whose brakes are asked for, as bits: their feed-forward alone acts on them.
  std::uint32_t braked = 0;
};

/// Rate of an error whose reading is quantised, as a drive estimates it: a tracking loop of second
/// order (α-β filter) with both poles at p = exp(-bandwidth · period), hence stable for any.
///
/// A loop on the reading y alone finds ẏ with a lag of about 2/bandwidth, F(s) = 1 / (1 + s/b)²;
/// ẏ_d - Fẏ then demands (1 - F) ẏ_d of a robot that follows exactly, and the PD buys that with a
/// tracking error of (kd/kp) (1 - F) ẏ_d. Here ẏ_d passes the same filter, F (ẏ_d - ẏ): the loop
/// predicts y by what is desired, less the rate ė that it has found,
///
///     ŷ(k) = ŷ(k-1) + T ((ẏ_d(k-1) + ẏ_d(k)) / 2 - ė(k-1)),
///
/// and what the reading does otherwise is news of ė alone. The trapezoid is right to T³. That y_d
/// enters by its rate only is meant: a setpoint that jumps moves no reading, and kicks nothing.
///
/// @param reading   y
/// @param expected  mean rate of y_d in the period that has passed
/// @param position  in and out: ŷ
/// @param rate      in and out: ė
inline void track(const ControlSettings& settings, Real pole, Real reading, Real expected,
                  Real& position, Real& rate) {
  const Real predicted = position + settings.period * (expected - rate);
  const Real innovation = reading - predicted;
  position = predicted + (1 - pole * pole) * innovation;
  rate -= (1 - pole) * (1 - pole) / settings.period * innovation;
}

/// A motor error's rate as rates of the errors that a law is made of.
template <Mobility K>
inline Extended in_terms_of(Corrects corrects, const Joint& rate, const Reference<K>& reference,
                            int r) {
  constexpr int n = kDof<K>;
  Extended result{};
  Coordinates twist{};
  for (int i = 0; i < n; ++i) {
    result[i] = rate[i];
    for (int j = 0; j < n; ++j) twist[i] += reference.jacobians.J[i][j] * rate[j];
  }
  if (corrects == Corrects::pose) std::copy_n(twist.begin(), n, result.begin());
  if (corrects == Corrects::readings)
    for (int k = 0; k < r; ++k)
      for (int i = 0; i < n; ++i) result[n + k] += reference.jr[k][i] * twist[i];
  return result;
}

/// A torque, no larger than the motor can.
inline Real limited(const Chain& chain, Real torque) {
  const Real limit = chain.torque_limit;
  return limit > 0 ? std::clamp(torque, -limit, limit) : torque;
}

/// Share of what was held at a switch that is left, from 1 to 0 without a corner.
inline Real led_out(Real leaving, Real whole) {
  const Real u = whole > 0 ? leaving / whole : 0;
  return u * u * (3 - 2 * u);
}

/// One cycle. Bounded work, no allocation, no exception, no lock. Where the law has changed since
/// the last one, or the readings were replaced, the error keeps its value and its rate: the
/// difference is led out.
///
/// @param q_e       readings of motors and sensors, size n + r
/// @param state     in and out; state.torque is the command
/// @param known     for laws that weigh
/// @return no answer: the torque of the last good cycle is held, nothing else changes;
/// near_singular: the torque is that of the damped J
template <Mobility K>
Outcome control(const Robot& robot, const ControlSettings& settings, const Setpoint& setpoint,
                const Extended& q_e, ControlState& state, const Weighing& known = {}) {
  constexpr int n = kDof<K>;
  if (!robot.finished) return {Status::unfinished, -1};
  // A law asks for the readings that it uses: usual control goes on without sensors.
  const Corrects corrects = properties(settings.law).corrects;
  const int asked = corrects == Corrects::motors ? n : n + robot.r;
  if (!all_finite(q_e, asked) || !all_finite(setpoint.x, n) || !all_finite(setpoint.rate, n) ||
      !all_finite(setpoint.acceleration, n))
    return {Status::not_finite, -1};
  const Scaled scaled(known, settings.sigma_scale);
  const Weighing& weighing = scaled.weighing;
  Reference<K> reference;
  Parasitic nearby = state.nearby;
  Outcome outcome = refer<K>(robot, settings.law, setpoint.x, reference, settings.damped_below,
                             weighing, &nearby);
  const Outcome regular = outcome;
  Joint error{}, error_rate{}, torque{};
  Pose found;
  if (outcome)
    outcome = motor_error<K>(robot, settings.law, reference, q_e, error, found, weighing, nearby);
  if (!outcome) return outcome;

  // The rate of ê_q is the law's own map of the rates of the errors that it is made of: of the
  // motors, of all readings, or of the estimated pose (so that θ is damped by its own, finer
  // counts). A TEJ moves with x_d; that term is of second order in the error and is left out.
  const bool posed = corrects == Corrects::pose, extended = corrects == Corrects::readings;
  const int tracked = extended ? n + robot.r : n;
  Extended measured{};
  std::copy_n(q_e.begin(), asked, measured.begin());
  const Joint joint_rate = reference.jacobians.joint_rate(setpoint.rate);
  const Real* desired = posed ? setpoint.rate.data() : joint_rate.data();
  if (posed) {
    const Coordinates x = to_coordinates<K>(found);
    std::copy_n(x.begin(), n, measured.begin());
  }
  // What a cycle without an answer leaves as it was is only written at the end.
  Extended position = state.position, rates = state.rate, passed = state.desired;
  Joint integral = state.integral, held = state.held, load{};
  Real leaving = state.leaving;
  const bool switches = state.started && (state.switched || state.law != settings.law);
  if (!state.started || switches) position = measured;
  if (switches) {
    rates = in_terms_of<K>(corrects, state.error_rate, reference, robot.r);
    for (int i = 0; i < n; ++i) held[i] = state.error[i] - error[i];
    leaving = settings.lead_out;
  }
  const Real share = led_out(leaving, settings.lead_out);
  leaving = std::max(0.0, leaving - settings.period);
  for (int i = 0; i < n; ++i) error[i] += share * held[i];
  Coordinates twist{};  // of x_d against x̂
  Pose from;
  if constexpr (K == Mobility::spatial)
    if (posed) {  // rotation vectors do not add: x̂ is tracked in the tangent space at its last pose
      Coordinates last{};
      std::copy_n(position.begin(), n, last.begin());
      from = to_pose<K>(last);
      const Coordinates step = difference<K>(found, from);
      std::copy_n(step.begin(), n, measured.begin());
      position.fill(0);
    }
  const Real pole = std::exp(-settings.velocity_bandwidth * settings.period);
  // Switched on, a robot counts as following until its readings say otherwise.
  const Real half = state.started ? 0.5 : 0;
  for (int c = 0; c < tracked; ++c) {
    Real rate = 0;
    if (c < n)
      rate = desired[c];
    else
      for (int j = 0; j < n; ++j) rate += reference.jr[c - n][j] * setpoint.rate[j];
    const Real expected = half * ((switches ? rate : passed[c]) + rate);
    if (switches) position[c] = measured[c] - settings.period * (expected - rates[c]);
    track(settings, pole, measured[c], expected, position[c], rates[c]);
    passed[c] = rate;
    if (extended)
      for (int i = 0; i < n; ++i) error_rate[i] += reference.tej[i][c] * rates[c];
    else if (posed)
      twist[c] = rates[c];
    else
      error_rate[c] = rates[c];
  }
  if (posed) error_rate = reference.jacobians.joint_rate(twist);
  if constexpr (K == Mobility::spatial)
    if (posed) {
      Coordinates step{};
      std::copy_n(position.begin(), n, step.begin());
      const Coordinates x = to_coordinates<K>(moved<K>(from, step));
      std::copy_n(x.begin(), n, position.begin());
    }
  // One NaN in what the state keeps would fail every later cycle, and what overflows then as well.
  Real sum = 0;
  for (int c = 0; c < tracked; ++c)
    sum += std::fabs(position[c]) + std::fabs(rates[c]) + std::fabs(passed[c]);

  const auto braked = [&](int i) { return state.braked >> i & 1U; };
  Joint pd{}, steps{};                         // of the gains; of the integrals
  for (int i = 0; i < n && state.braked; ++i)  // nor do the others allow for what it does not do
    if (braked(i)) error[i] = error_rate[i] = integral[i] = 0;
  for (int i = 0; i < n; ++i) {
    pd[i] = settings.kp[i] * error[i] + settings.kd[i] * error_rate[i];
    steps[i] = settings.ki[i] * settings.period * error[i];
  }
  // A motor's inertia, and how it pulls at the others, change with the pose: gains of the diagonal
  // at one pose place their poles there, if at all. With τ = slope Jᵀ (M (ẍ_d + J a) + c) and
  // a = kp ê_q + kd dê_q/dt, the model leaves d²ê_q/dt² = -a: each component by itself, everywhere.
  const bool shaped = settings.gains == Gains::inertia;
  if (shaped || settings.feed_forward != FeedForward::none) {
    DynamicModel<K> model;
    const auto& J = reference.jacobians.J;
    const bool full = settings.feed_forward == FeedForward::full;
    outcome =
        dynamic_model<K>(robot, reference.closure, full ? setpoint.rate : Coordinates{}, model);
    if (!outcome) return outcome;
    if (settings.feed_forward == FeedForward::none) model.bias.fill(0);
    torque = inverse_dynamics<K>(model, J, full ? setpoint.acceleration : Coordinates{});
    if (shaped) {
      model.bias.fill(0);
      pd = inverse_dynamics<K>(model, J, pose_rate<K>(J, pd));
      steps = inverse_dynamics<K>(model, J, pose_rate<K>(J, steps));
    }
  }
  for (int i = 0; i < n && state.braked; ++i)
    if (braked(i)) pd[i] = steps[i] = 0;
  for (int i = 0; i < n; ++i) {
    const Real limit = robot.chain[i].torque_limit;
    const Real step = steps[i];
    load[i] = torque[i] + integral[i];
    const Real wanted = load[i] + pd[i];
    const bool pushes = limit > 0 && std::fabs(wanted) > limit && wanted * step > 0;
    if (!pushes) integral[i] += step;  // a saturated motor does not wind up
    torque[i] = wanted + (pushes ? 0 : step);
    // Before the limit and the brakes, which hide what is infinite.
    sum += std::fabs(wanted) + std::fabs(step) + std::fabs(held[i]) + std::fabs(joint_rate[i]);
    torque[i] = limited(robot.chain[i], torque[i]);
  }
  if (!(sum < by_precision(1e100L, 1e30L))) return {Status::not_finite, -1};
  state.started = true;
  state.switched = false;
  state.law = settings.law;
  state.position = position;
  state.rate = rates;
  state.desired = passed;
  state.integral = integral;
  state.held = held;
  state.leaving = leaving;
  state.torque = torque;
  state.error = error;
  state.error_rate = error_rate;
  state.load = load;
  state.nearby = nearby;
  for (int i = 0; i < n; ++i) state.q_d[i] = reference.q_e[i] + settings.period * joint_rate[i];
  return regular;
}

inline Outcome control(const Robot& robot, const ControlSettings& settings,
                       const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                       const Weighing& weighing = {}) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    return control<mobility()>(robot, settings, setpoint, q_e, state, weighing);
  });
}

/// PD gains by pole placement. Of the diagonal: motor i alone, held at that pose, answers as a
/// second order of that natural frequency (rad/s) and damping ratio. Shaped by the inertia: so does
/// every motor at every pose, and x is not asked for more than that it exists.
inline Outcome place_poles(const Robot& robot, const Coordinates& x, Real frequency, Real damping,
                           ControlSettings& settings) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Closure<K> closure;
    Jacobians<K> jacobians;
    DynamicModel<K> model;
    Outcome outcome = ikm<K>(robot, to_pose<K>(x), closure);
    if (outcome) outcome = jacobian<K>(closure, jacobians);
    if (outcome) outcome = dynamic_model<K>(robot, closure, Coordinates{}, model);
    if (!outcome) return outcome;
    const auto inertia = joint_inertia<K>(model, jacobians.J);
    for (int m = 0; m < n; ++m) {
      // The error is one of readings, the torque the motor's own.
      const Real of = settings.gains == Gains::inertia ? 1 : model.slope[m] * inertia[m][m];
      settings.kp[m] = of * frequency * frequency;
      settings.kd[m] = 2 * damping * of * frequency;
    }
    if (!all_finite(settings.kp, n) || !all_finite(settings.kd, n))
      outcome = {Status::not_finite, -1};
    return outcome;
  });
}

}  // namespace truepose
