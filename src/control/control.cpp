// One control cycle: readings and setpoint in, motor torques out.
#include "control/control.hpp"

namespace truepose {
void track(const ControlSettings& settings, Real pole, Real reading, Real expected, Real& position,
           Real& rate) {
  const Real predicted = position + settings.period * (expected - rate);
  const Real innovation = reading - predicted;
  position = predicted + (1 - pole * pole) * innovation;
  rate -= (1 - pole) * (1 - pole) / settings.period * innovation;
}

namespace {
/// Remaining share of the offset held at a switch, from 1 to 0, smooth at both ends.
Real led_out(Real leaving, Real whole) {
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
        n(dof(robot.mobility)),
        m(robot.motors) {}

  /// Whether the inputs that the law uses are finite: the joint law runs without sensors.
  bool finite() const {
    return all_finite(q_e_, readings()) && all_finite(setpoint_.x, n) &&
           all_finite(setpoint_.rate, n) && all_finite(setpoint_.acceleration, n);
  }

  /// ê_q of the law, and J, TEJ at x_d.
  Outcome correct(const Weighing& weighing) {
    state_.nearby.left = cycle_steps(robot_);
    const Outcome regular = refer(robot_, settings_.law, setpoint_.x, reference_,
                                  settings_.damped_below, weighing, &state_.nearby);
    Outcome outcome = regular;
    if (outcome)
      outcome = motor_error(robot_, settings_.law, reference_, q_e_, state_.error, found_, weighing,
                            &state_.nearby.search);
    return outcome ? regular : outcome;
  }

  /// Collects the inputs of the tracking loops. The rate of ê_q is the law's own map of the rates
  /// of its errors: of the motors, of all readings, or of the estimated pose (so θ is damped by its
  /// own, finer counts). The TEJ's own rate is left out: of second order in the error.
  void measure() {
    copy_first(readings(), q_e_, measured_);
    joint_rate_ = reference_.jacobians.joint_rate(setpoint_.rate);
    if (!posed()) return;
    const Coordinates x = to_coordinates(robot_.mobility, found_);
    copy_first(n, x, measured_);
  }

  /// After a switch of law or readings the error keeps its value and rate, and the jump is led out.
  void blend() {
    if (!before_.started || switches()) state_.position = measured_;
    if (switches()) {
      state_.rate =
          in_terms_of(before_.error_rate, pose_rate(reference_.jacobians, before_.error_rate));
      for (int i : range(m)) state_.held[i] = before_.error[i] - state_.error[i];
      state_.leaving = settings_.lead_out;
    }
    const Real share = led_out(state_.leaving, settings_.lead_out);
    state_.leaving = max(0.0, state_.leaving - settings_.period);
    for (int i : range(m)) state_.error[i] += share * state_.held[i];
  }

  /// Rates of the errors by their tracking loops, and of ê_q by the law.
  void follow() {
    const Pose from = to_tangent();
    const Real pole = exp(-settings_.velocity_bandwidth * settings_.period);
    // At the start the robot counts as following until its readings differ.
    const Real half = before_.started ? 0.5 : 0;
    const int tracked = posed() ? n : readings();
    const Extended desired = in_terms_of(joint_rate_, setpoint_.rate);
    Coordinates twist{};  // of x_d against x̂
    state_.error_rate = {};
    for (int c : range(tracked)) {
      const Real rate = desired[c];
      const Real expected = half * ((switches() ? rate : state_.desired[c]) + rate);
      if (switches())
        state_.position[c] = measured_[c] - settings_.period * (expected - state_.rate[c]);
      track(settings_, pole, measured_[c], expected, state_.position[c], state_.rate[c]);
      state_.desired[c] = rate;
      if (corrects_ == Corrects::readings)
        for (int i : range(m)) state_.error_rate[i] += reference_.tej[i][c] * state_.rate[c];
      else if (posed())
        twist[c] = state_.rate[c];
      else
        state_.error_rate[c] = state_.rate[c];
    }
    if (posed()) state_.error_rate = reference_.jacobians.joint_rate(twist);
    from_tangent(from);
    for (int c : range(tracked))
      sum_ += fabs(state_.position[c]) + fabs(state_.rate[c]) + fabs(state_.desired[c]);
  }

  /// Torques of model, integrals and gains, limited.
  ///
  /// A motor's inertia and its coupling to the others change with the pose: diagonal gains place
  /// the poles at one pose, if at all. With τ = slope Jᵀ (M (ẍ_d + J a) + c) and
  /// a = kp ê_q + kd dê_q/dt, the model leaves d²ê_q/dt² = -a, decoupled at every pose.
  Outcome command_torques() {
    for (int i = 0; i < m && before_.braked; ++i)  // the others do not compensate it
      if (braked(i)) state_.error[i] = state_.error_rate[i] = state_.integral[i] = 0;
    Joint pd{}, steps{}, torque{};  // of the gains; of the integrals; of the model
    for (int i : range(m)) {
      pd[i] = settings_.kp[i] * state_.error[i] + settings_.kd[i] * state_.error_rate[i];
      steps[i] = settings_.ki[i] * settings_.period * state_.error[i];
    }
    const bool shaped = settings_.gains == Gains::inertia;
    if (shaped || settings_.feed_forward != FeedForward::none) {
      DynamicModel model;
      const auto& J = reference_.jacobians.J;
      const bool full = settings_.feed_forward == FeedForward::full;
      const Coordinates still{}, &rate = full ? setpoint_.rate : still,
                                 &acceleration = full ? setpoint_.acceleration : still;
      const Outcome outcome =
          dynamic_model(robot_, reference_.closure, rate, model, shaped ? nullptr : &acceleration);
      if (!outcome) return outcome;
      if (!shaped) {
        torque = motor_torques(n, m, J, model.bias, model.slope);
      } else {
        if (settings_.feed_forward == FeedForward::none) model.bias.fill(0);
        torque = inverse_dynamics(model, J, acceleration);
        model.bias.fill(0);
        pd = inverse_dynamics(model, J, pose_rate(reference_.jacobians, pd));
        steps = inverse_dynamics(model, J, pose_rate(reference_.jacobians, steps));
      }
    }
    for (int i = 0; i < m && before_.braked; ++i)
      if (braked(i)) pd[i] = steps[i] = 0;
    for (int i : range(m)) limit(i, torque[i], pd[i], steps[i]);
    if (m > n) make_up_for_limits();
    // A NaN in the state would fail every later cycle, as would what overflows then.
    if (!(sum_ < by_precision(1e100L, 1e30L))) return {Status::not_finite};
    return {};
  }

  /// Completes the state after all steps had an answer.
  void complete() {
    state_.started = true;
    state_.switched = false;
    state_.law = settings_.law;
    for (int i : range(m)) state_.q_d[i] = reference_.q_e[i] + settings_.period * joint_rate_[i];
  }

 private:
  bool posed() const { return corrects_ == Corrects::pose; }
  bool switches() const {
    return before_.started && (before_.switched || before_.law != settings_.law);
  }
  bool braked(int i) const { return before_.braked >> i & 1U; }
  int readings() const { return corrects_ == Corrects::motors ? m : m + robot_.r; }

  /// Rates of the quantities that the law corrects, for rates of the motors and the platform.
  Extended in_terms_of(const Joint& rate, const Coordinates& twist) const {
    Extended result{};
    copy_first(m, rate, result);
    if (posed()) copy_first(n, twist, result);
    for (int c : range(m, readings()))
      for (int i : range(n)) result[c] += reference_.jr[c - m][i] * twist[i];
    return result;
  }

  /// Rotation vectors do not add: x̂ is tracked in the tangent space at its last pose.
  bool turns() const { return posed() && robot_.mobility == Mobility::spatial; }
  Pose to_tangent() {
    Pose from;
    if (!turns()) return from;
    Coordinates last{};
    copy_first(n, state_.position, last);
    from = to_pose(robot_.mobility, last);
    const Coordinates step = difference(robot_.mobility, found_, from);
    copy_first(n, step, measured_);
    state_.position.fill(0);
    return from;
  }
  void from_tangent(const Pose& from) {
    if (!turns()) return;
    Coordinates step{};
    copy_first(n, state_.position, step);
    const Coordinates x = to_coordinates(robot_.mobility, moved(robot_.mobility, from, step));
    copy_first(n, x, state_.position);
  }

  /// Limits a torque. @param step  of the integral: none that pushes a saturated motor further
  void limit(int i, Real model, Real pd, Real step) {
    const Real most = robot_.chain[i].torque_limit;
    state_.load[i] = model + state_.integral[i];
    const Real wanted = state_.load[i] + pd;
    const bool pushes = most > 0 && fabs(wanted) > most && wanted * step > 0;
    if (!pushes) state_.integral[i] += step;
    // Before the limit and the brakes, which hide infinities.
    sum_ += fabs(wanted) + fabs(step) + fabs(joint_rate_[i]);
    sum_ += fabs(state_.held[i]);
    wanted_[i] = wanted + (pushes ? 0 : step);
    state_.torque[i] = limited(robot_.chain[i], wanted_[i]);
  }

  /// Redundant motors within their limits add the smallest torques that make up for the force which
  /// those at their limits lack.
  void make_up_for_limits() {
    const Jacobians& at = reference_.jacobians;
    std::uint32_t excluded = before_.braked;
    Joint lacks{};
    for (int i : range(m)) lacks[i] = braked(i) ? 0 : wanted_[i] - state_.torque[i];
    for (int left = m - n; left > 0; --left) {
      Coordinates force{};
      Square K, inverse;  // of the motors that can add
      Unknowns size{};
      std::array<int, kMaxMotors> motor;
      int count = 0;
      for (int i : range(m)) {
        const Real rate = reference_.closure.chain[i].rate;
        if (lacks[i] != 0) excluded |= 1U << i;
        const bool adds = !(excluded >> i & 1U);
        for (int j : range(n)) {
          const Real k = at.jx[i][j] / at.jq[i];
          force[j] += k * rate * lacks[i];
          if (adds) K[count][j] = k, size[j] += k * k;
        }
        if (adds) motor[count++] = i;
      }
      if (count == m || count < n || !invert(count, n, K, size, inverse)) return;
      lacks = {};
      for (int c : range(count)) {
        Real& torque = state_.torque[motor[c]];
        const Real more = sum_of(n, [&](int j) { return inverse[j][c] * force[j]; });
        const Real next = torque + more / reference_.closure.chain[motor[c]].rate;
        torque = limited(robot_.chain[motor[c]], next);
        lacks[motor[c]] = next - torque;
      }
    }
  }

  const Robot& robot_;
  const ControlSettings& settings_;
  const Setpoint& setpoint_;
  const Extended& q_e_;
  const ControlState& before_;
  ControlState& state_;
  const Corrects corrects_;
  const int n, m;  ///< freedoms, motors
  Reference reference_;
  Pose found_;           ///< x̂, of laws of the pose
  Extended measured_{};  ///< readings, or x̂
  Joint joint_rate_{};   ///< of q_d
  Joint wanted_;         ///< torques before their limits
  Real sum_ = 0;         ///< of all that is stored: not finite if any of it is not
};
}  // namespace

Outcome control(const Robot& robot, const ControlSettings& settings, const Setpoint& setpoint,
                const Extended& q_e, ControlState& state, const Weighing& known) {
  if (!robot.finished) return {Status::unfinished};
  const ControlState before = state;
  ControlCycle cycle(robot, settings, setpoint, q_e, before, state);
  if (!cycle.finite()) return {Status::not_finite};
  const Scaled scaled(known, settings.sigma_scale);
  const Outcome regular = cycle.correct(scaled.weighing);
  Outcome outcome = regular;
  if (outcome) {
    cycle.measure();
    cycle.blend();
    cycle.follow();
    outcome = cycle.command_torques();
  }
  if (outcome) {
    cycle.complete();
  } else {
    const PoseSearch search = state.nearby.search;
    state = before;
    state.nearby.search = search;
  }
  return outcome ? regular : outcome;
}

Outcome place_poles(const Robot& robot, const Coordinates& x, Real frequency, Real damping,
                    ControlSettings& settings) {
  const int motors = robot.motors;
  AtRest at;
  Outcome outcome = at.find(robot, to_pose(robot.mobility, x));
  if (!outcome) return outcome;
  for (int m : range(motors)) {
    // The error is in readings, the torque is the motor's own.
    const Real of = settings.gains == Gains::inertia ? 1 : at.model.slope[m] * at.inertia[m][m];
    settings.kp[m] = of * frequency * frequency;
    settings.kd[m] = 2 * damping * of * frequency;
  }
  if (!all_finite(settings.kp, motors) || !all_finite(settings.kd, motors))
    outcome = {Status::not_finite};
  return outcome;
}
}  // namespace truepose
