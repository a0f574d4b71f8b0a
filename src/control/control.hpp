// One control cycle: readings and setpoint in, motor torques out.
#pragma once

#include <algorithm>

#include "control/dynamics.hpp"
#include "control/law.hpp"
#include "control/trajectory.hpp"

namespace truepose {
enum class FeedForward : int {
  none = 0,
  gravity = 1,  ///< holds the nominal robot at x_d
  full = 2,     ///< gravity, inertia and Coriolis of the nominal robot along the trajectory
};

/// What kp, kd and ki mean.
enum class Gains : int {
  diagonal = 0,  ///< torques, each motor's from its own error alone: N·m/rad (N/m) and so on
  inertia = 1,   ///< accelerations, 1/s², 1/s and 1/s³, that the joint inertia turns into torques
};

/// Constant during a run.
struct ControlSettings {
  std::uint32_t size = sizeof(truepose_control_settings);  ///< for the C interface
  Law law = Law::joint;
  Gains gains = Gains::diagonal;
  FeedForward feed_forward = FeedForward::full;
  /// Factor on every reading's own σ in laws that weigh. A calibration leaves errors that nearly
  /// cancel in the readings; their optimal weights multiply differences of readings, hence also the
  /// effects of arms and drives on these. Larger σ, smaller multiples.
  int sigma_scale = 1;
  int unused = 0;
  Real period = 1e-3;              ///< s
  Real velocity_bandwidth = 1500;  ///< of the velocity tracking loops, rad/s
  Real damped_below = 0;           ///< conditioning below which J is damped (0: never)
  Real lead_out = 0.2;             ///< time over which a switch of law or readings takes effect, s
  Joint kp{};                      ///< N·m/rad (N/m), or 1/s²
  Joint kd{};                      ///< N·m·s/rad, or 1/s
  Joint ki{};                      ///< N·m/(rad·s), or 1/s³; 0: no integral action
};

/// State of a controller. Zero it to switch the controller on.
struct ControlState {
  bool started = false;
  Extended position{};    ///< of the tracking loops: the readings, or x̂
  Extended rate{};        ///< of the tracking loops: rates of the error, desired minus actual
  Extended desired{};     ///< desired rate in the last cycle
  Joint integral{};       ///< N·m
  Joint torque{};         ///< the last one commanded; held when a cycle fails
  Joint error{};          ///< ê_q of the last good cycle
  Joint error_rate{};     ///< its rate, estimated
  Joint q_d{};            ///< desired motor readings a period later, extrapolated
  Joint load{};           ///< feed-forward and integral part of the torque, N·m
  Parasitic nearby;       ///< residual motion at x_d, at the full level
  Law law = Law::joint;   ///< whose terms `position` and `rate` are in
  bool switched = false;  ///< set where readings are substituted: prevents a step
  Joint held{};           ///< ê_q before the last switch minus ê_q after it,
  Real leaving = 0;       ///< and the time over which it is still led out, s
  /// Motors with requested brakes, as bits: only their feed-forward acts.
  std::uint32_t braked = 0;
};

/// Rate of an error from a quantized reading, as in a drive: a second-order tracking loop (α-β
/// filter) with both poles at p = exp(-bandwidth · period), hence stable for any bandwidth.
///
/// A loop on the reading y alone estimates ẏ with a lag of about 2/bandwidth,
/// F(s) = 1 / (1 + s/b)². Then ẏ_d - Fẏ demands (1 - F) ẏ_d of a robot that follows exactly, which
/// costs a tracking error of (kd/kp) (1 - F) ẏ_d. Here ẏ_d passes the same filter, F (ẏ_d - ẏ): the
/// loop predicts y from the desired rate minus its estimate ė,
///
///     ŷ(k) = ŷ(k-1) + T ((ẏ_d(k-1) + ẏ_d(k)) / 2 - ė(k-1)),
///
/// and the innovation corrects ė alone. The trapezoid is accurate to T³. Only the rate of y_d
/// enters, on purpose: a step of the setpoint moves no reading and causes no kick.
/// @param reading   y
/// @param expected  mean rate of y_d in the period that has passed
/// @param position  in and out: ŷ
/// @param rate      in and out: ė
void track(const ControlSettings& settings, Real pole, Real reading, Real expected, Real& position,
           Real& rate);

/// Maps a motor error's rate to rates of the errors that a law corrects.
Extended in_terms_of(Corrects corrects, const Joint& rate, const Reference& reference, int r);

/// Limits a torque to the motor's.
inline Real limited(const Chain& chain, Real torque) {
  const Real limit = chain.torque_limit;
  return limit > 0 ? std::clamp(torque, -limit, limit) : torque;
}

/// Remaining share of the offset held at a switch, from 1 to 0, smooth at both ends.
inline Real led_out(Real leaving, Real whole) {
  const Real u = whole > 0 ? leaving / whole : 0;
  return u * u * (3 - 2 * u);
}

/// The steps of one cycle in order: correct, measure, blend, follow, drive, keep.
class ControlCycle {
 public:
  ControlCycle(const Robot& robot, const ControlSettings& settings, const Setpoint& setpoint,
               const Extended& q_e, const ControlState& before, ControlState& state)
      : robot_(robot),
        settings_(settings),
        setpoint_(setpoint),
        q_e_(q_e),
        before_(before),
        state_(state),
        corrects_(properties(settings.law).corrects),
        n(dof(robot.mobility)) {}

  /// Whether the inputs that the law uses are finite: the joint law runs without sensors.
  bool finite() const {
    return all_finite(q_e_, readings()) && all_finite(setpoint_.x, n) &&
           all_finite(setpoint_.rate, n) && all_finite(setpoint_.acceleration, n);
  }

  /// ê_q of the law, and J, TEJ at x_d.
  Outcome correct(const Weighing& weighing) {
    const Outcome regular = refer(robot_, settings_.law, setpoint_.x, reference_,
                                  settings_.damped_below, weighing, &state_.nearby);
    Outcome outcome = regular;
    if (outcome)
      outcome = motor_error(robot_, settings_.law, reference_, q_e_, state_.error, found_, weighing,
                            state_.nearby);
    return outcome ? regular : outcome;
  }

  /// Collects the inputs of the tracking loops. The rate of ê_q is the law's own map of the rates
  /// of its errors: of the motors, of all readings, or of the estimated pose (so θ is damped by its
  /// own, finer counts). The TEJ's own rate is left out: of second order in the error.
  void measure() {
    std::copy_n(q_e_.begin(), readings(), measured_.begin());
    joint_rate_ = reference_.jacobians.joint_rate(setpoint_.rate);
    if (!posed()) return;
    const Coordinates x = to_coordinates(robot_.mobility, found_);
    std::copy_n(x.begin(), n, measured_.begin());
  }

  /// After a switch of law or readings the error keeps its value and rate, and the jump is led out.
  void blend() {
    if (!before_.started || switches()) state_.position = measured_;
    if (switches()) {
      state_.rate = in_terms_of(corrects_, before_.error_rate, reference_, robot_.r);
      for (int i = 0; i < n; ++i) state_.held[i] = before_.error[i] - state_.error[i];
      state_.leaving = settings_.lead_out;
    }
    const Real share = led_out(state_.leaving, settings_.lead_out);
    state_.leaving = std::max(0.0, state_.leaving - settings_.period);
    for (int i = 0; i < n; ++i) state_.error[i] += share * state_.held[i];
  }

  /// Rates of the errors by their tracking loops, and of ê_q by the law.
  void follow() {
    const Pose from = to_tangent();
    const Real pole = std::exp(-settings_.velocity_bandwidth * settings_.period);
    // At the start the robot counts as following until its readings differ.
    const Real half = before_.started ? 0.5 : 0;
    const int tracked = corrects_ == Corrects::readings ? n + robot_.r : n;
    Coordinates twist{};  // of x_d against x̂
    state_.error_rate = {};
    for (int c = 0; c < tracked; ++c) {
      const Real rate = desired_rate(c);
      const Real expected = half * ((switches() ? rate : state_.desired[c]) + rate);
      if (switches())
        state_.position[c] = measured_[c] - settings_.period * (expected - state_.rate[c]);
      track(settings_, pole, measured_[c], expected, state_.position[c], state_.rate[c]);
      state_.desired[c] = rate;
      if (corrects_ == Corrects::readings)
        for (int i = 0; i < n; ++i) state_.error_rate[i] += reference_.tej[i][c] * state_.rate[c];
      else if (posed())
        twist[c] = state_.rate[c];
      else
        state_.error_rate[c] = state_.rate[c];
    }
    if (posed()) state_.error_rate = reference_.jacobians.joint_rate(twist);
    from_tangent(from);
    for (int c = 0; c < tracked; ++c)
      sum_ +=
          std::fabs(state_.position[c]) + std::fabs(state_.rate[c]) + std::fabs(state_.desired[c]);
  }

  /// Torques of model, integrals and gains, limited.
  ///
  /// A motor's inertia and its coupling to the others change with the pose: diagonal gains place
  /// the poles at one pose, if at all. With τ = slope Jᵀ (M (ẍ_d + J a) + c) and
  /// a = kp ê_q + kd dê_q/dt, the model leaves d²ê_q/dt² = -a, decoupled at every pose.
  Outcome command_torques() {
    for (int i = 0; i < n && before_.braked; ++i)  // the others do not compensate it
      if (braked(i)) state_.error[i] = state_.error_rate[i] = state_.integral[i] = 0;
    Joint pd{}, steps{}, torque{};  // of the gains; of the integrals; of the model
    for (int i = 0; i < n; ++i) {
      pd[i] = settings_.kp[i] * state_.error[i] + settings_.kd[i] * state_.error_rate[i];
      steps[i] = settings_.ki[i] * settings_.period * state_.error[i];
    }
    const bool shaped = settings_.gains == Gains::inertia;
    if (shaped || settings_.feed_forward != FeedForward::none) {
      DynamicModel model;
      const auto& J = reference_.jacobians.J;
      const bool full = settings_.feed_forward == FeedForward::full;
      const Outcome outcome =
          dynamic_model(robot_, reference_.closure, full ? setpoint_.rate : Coordinates{}, model);
      if (!outcome) return outcome;
      if (settings_.feed_forward == FeedForward::none) model.bias.fill(0);
      torque = inverse_dynamics(model, J, full ? setpoint_.acceleration : Coordinates{});
      if (shaped) {
        model.bias.fill(0);
        pd = inverse_dynamics(model, J, pose_rate(reference_.jacobians, pd));
        steps = inverse_dynamics(model, J, pose_rate(reference_.jacobians, steps));
      }
    }
    for (int i = 0; i < n && before_.braked; ++i)
      if (braked(i)) pd[i] = steps[i] = 0;
    for (int i = 0; i < n; ++i) limit(i, torque[i], pd[i], steps[i]);
    // A NaN in the state would fail every later cycle, as would what overflows then.
    if (!(sum_ < by_precision(1e100L, 1e30L))) return {Status::not_finite, -1};
    return {};
  }

  /// Completes the state after all steps had an answer.
  void complete() {
    state_.started = true;
    state_.switched = false;
    state_.law = settings_.law;
    for (int i = 0; i < n; ++i)
      state_.q_d[i] = reference_.q_e[i] + settings_.period * joint_rate_[i];
  }

 private:
  bool posed() const { return corrects_ == Corrects::pose; }
  bool switches() const {
    return before_.started && (before_.switched || before_.law != settings_.law);
  }
  bool braked(int i) const { return before_.braked >> i & 1U; }
  int readings() const { return corrects_ == Corrects::motors ? n : n + robot_.r; }

  Real desired_rate(int c) const {
    if (c < n) return posed() ? setpoint_.rate[c] : joint_rate_[c];
    Real rate = 0;
    for (int j = 0; j < n; ++j) rate += reference_.jr[c - n][j] * setpoint_.rate[j];
    return rate;
  }

  /// Rotation vectors do not add: x̂ is tracked in the tangent space at its last pose.
  Pose to_tangent() {
    Pose from;
    if (robot_.mobility == Mobility::spatial)
      if (posed()) {
        Coordinates last{};
        std::copy_n(state_.position.begin(), n, last.begin());
        from = to_pose(robot_.mobility, last);
        const Coordinates step = difference(robot_.mobility, found_, from);
        std::copy_n(step.begin(), n, measured_.begin());
        state_.position.fill(0);
      }
    return from;
  }
  void from_tangent([[maybe_unused]] const Pose& from) {
    if (robot_.mobility == Mobility::spatial)
      if (posed()) {
        Coordinates step{};
        std::copy_n(state_.position.begin(), n, step.begin());
        const Coordinates x = to_coordinates(robot_.mobility, moved(robot_.mobility, from, step));
        std::copy_n(x.begin(), n, state_.position.begin());
      }
  }

  /// Limits a torque. @param step  of the integral: none that pushes a saturated motor further
  void limit(int i, Real model, Real pd, Real step) {
    const Real most = robot_.chain[i].torque_limit;
    state_.load[i] = model + state_.integral[i];
    const Real wanted = state_.load[i] + pd;
    const bool pushes = most > 0 && std::fabs(wanted) > most && wanted * step > 0;
    if (!pushes) state_.integral[i] += step;
    // Before the limit and the brakes, which hide infinities.
    sum_ += std::fabs(wanted) + std::fabs(step) + std::fabs(joint_rate_[i]);
    sum_ += std::fabs(state_.held[i]);
    state_.torque[i] = limited(robot_.chain[i], wanted + (pushes ? 0 : step));
  }

  const Robot& robot_;
  const ControlSettings& settings_;
  const Setpoint& setpoint_;
  const Extended& q_e_;
  const ControlState& before_;
  ControlState& state_;
  const Corrects corrects_;
  const int n;
  Reference reference_;
  Pose found_;           ///< x̂, of laws of the pose
  Extended measured_{};  ///< readings, or x̂
  Joint joint_rate_{};   ///< of q_d
  Real sum_ = 0;         ///< of all that is stored: not finite if any of it is not
};

/// Runs one cycle. Bounded work, no allocation, no exception, no lock.
/// @param q_e    readings of motors and sensors, size n + r
/// @param state  in and out; state.torque is the command
/// @param known  for laws that weigh
/// @return no answer: the last valid torque is held, nothing else changes; near_singular: the
/// torque is that of the damped J
inline Outcome control(const Robot& robot, const ControlSettings& settings,
                       const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                       const Weighing& known = {}) {
  if (!robot.finished) return {Status::unfinished, -1};
  const ControlState before = state;
  ControlCycle cycle(robot, settings, setpoint, q_e, before, state);
  if (!cycle.finite()) return {Status::not_finite, -1};
  const Scaled scaled(known, settings.sigma_scale);
  const Outcome regular = cycle.correct(scaled.weighing);
  Outcome outcome = regular;
  if (outcome) {
    cycle.measure();
    cycle.blend();
    cycle.follow();
    outcome = cycle.command_torques();
  }
  if (outcome)
    cycle.complete();
  else
    state = before;
  return outcome ? regular : outcome;
}

/// PD gains by pole placement: a second-order response of that natural frequency (rad/s) and
/// damping ratio. Diagonal gains give it to motor i alone, held at pose x; gains shaped by the
/// inertia to every motor at every pose, and x must only be valid.
Outcome place_poles(const Robot& robot, const Coordinates& x, Real frequency, Real damping,
                    ControlSettings& settings);
}  // namespace truepose
