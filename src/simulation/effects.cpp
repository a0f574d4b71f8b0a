// Physical effects of the exact plant that the model omits: friction, compliance, backlash, ripple.
#include "simulation/effects.hpp"

namespace truepose {
bool Effects::change_torque() const {
  return ripple > 0 || arm_stiffness > 0 ||
         std::ranges::any_of(friction, [](double f) { return f > 0; });
}

double dahl(double slip, double displacement, double presliding) {
  const double side = displacement > 0 ? 1 : -1;
  return side + (slip - side) * exp(-fabs(displacement) / presliding);
}

Plant::Plant(const Robot& truth, const Effects& effects, const Pose& start, std::uint64_t seed)
    : truth_(truth),
      n(truth.motors),
      driven_(truth),
      effects_(effects),
      state_{start, {}},
      random_(seed) {
  brake_gives_.fill(kBrakePresliding);
  for (int i : range(n)) {  // the robot file has rotor and arm as one inertia
    const Chain& chain = truth.chain[i];
    rotor_[i] = max(chain.drive_inertia - chain.arm_mass * chain.arm * chain.arm / 3,
                    0.1 * chain.drive_inertia);
    if (springy(i)) driven_.chain[i].drive_inertia -= rotor_[i];
  }
}

Outcome Plant::rest() {
  Closure closure;
  Outcome outcome = ikm(truth_, state_.pose, closure);
  if (outcome) outcome = hold(truth_, state_.pose, transmitted_);
  if (!outcome) return outcome;
  const Joint q = closure.q();
  for (int i : range(n))
    rotors_[i] = shaft(i, q[i]) + (springy(i) ? transmitted_[i] / effects_.arm_stiffness : 0);
  Extended q_e{};
  outcome = extended(level_of(truth_), truth_, state_.pose, q_e, &rest_);
  for (int k : range(truth_.r)) geared_[k] = q_e[n + k];
  return outcome;
}

void Plant::brake(std::uint32_t motors, double period) {
  for (int i : range(n)) {
    closing_[i] = motors >> i & 1U ? closing_[i] + period : 0;
    if (closing_[i] == 0) brake_[i] = 0;
    if (closing_[i] > kBrakeCloses) brake_[i] = brake_torque(i);
  }
}

void Plant::disturb(const Event& event, double sign) {
  if (event.kind == Disturbance::payload && driven_.bodies < kMaxBodies) {
    driven_.body[driven_.bodies] = Body{};
    driven_.body[driven_.bodies++].mass = event.size;
  }
  if (event.kind == Disturbance::friction) effects_.friction[event.motor] += event.size;
  for (int j = 0; j < dof(truth_.mobility) && event.kind == Disturbance::contact; ++j)
    force_[j] += sign * event.force[j];
  pushed_ = std::ranges::any_of(force_, [](double f) { return f != 0; });
}

void Plant::engage() {
  for (int i : range(n)) {
    brake_[i] = brake_torque(i);
    if (truth_.chain[i].actuator != Actuator::revolute) brake_gives_[i] = kSlideGives;
    rubs_[i] = brake_[i] > 0 ? clamp(-transmitted_[i] / brake_[i], -1.0, 1.0) : 0;
  }
  asked_ = ~0U;
  engaged_ = true;
}

void Plant::work_brakes(std::uint32_t motors, double period, double opens, double closes) {
  clock_ += period;
  for (int i : range(n)) {
    const bool closed = motors >> i & 1U;
    if (closed != (asked_ >> i & 1U))
      (closed ? closes_ : opens_)[i] = clock_ + (closed ? closes : opens);
    if (clock_ >= opens_[i] && opens_[i] > 0) brake_[i] = opens_[i] = 0;
    if (clock_ >= closes_[i] && closes_[i] > 0) {
      brake_[i] = brake_torque(i);
      rubs_[i] = opens_[i] = closes_[i] = 0;
    }
  }
  asked_ = motors;
}

Outcome Plant::advance(const Joint& torque, double period, int steps) {
  const bool braked = std::ranges::any_of(brake_, [](double torque) { return torque > 0; });
  if (!effects_.change_torque() && !braked && !pushed_) {
    transmitted_ = torque;
    return truepose::advance(driven_, torque, period, steps, state_);
  }
  if (effects_.arm_stiffness > 0 || braked) steps = max(steps, kCompliantSteps);
  if (engaged_) steps = max(steps, 2 * kCompliantSteps);
  for (int s = 0; s < steps; ++s) {
    Rotors turned = rotors_;
    const Outcome outcome =
        step(driven_, period / steps, state_, turned,
             [&](const Closure& closure, const DynamicModel& model, const Rotors& y, Rotors& dy) {
               Joint all = transmitted(closure.q(), model.rate, torque, y, dy);
               if (pushed_) push(closure, model, all);
               return all;
             });
    if (!outcome) return outcome;
    for (int i : range(n)) {
      const double moved_by = turned[i] - rotors_[i];
      if (moved_by == 0) continue;
      slip_[i] = dahl(slip_[i], moved_by, effects_.presliding);
      // Dahl's friction creeps under a load that swings; a brake at rest does not.
      rubs_[i] = engaged_ ? clamp(rubs_[i] + moved_by / brake_gives_[i], -1.0, 1.0)
                          : dahl(rubs_[i], moved_by, brake_gives_[i]);
    }
    rotors_ = turned;
  }
  return {};
}

Outcome Plant::measure(Extended& q_e) {
  Outcome outcome;
  if (effects_.give_way()) {
    Robot robot = truth_;
    outcome = bend(robot);
    if (outcome) outcome = extended(level_of(robot), robot, state_.pose, q_e, &rest_);
  } else {
    outcome = extended(level_of(truth_), truth_, state_.pose, q_e, &rest_);
  }
  if (!outcome) return outcome;
  for (int k : range(truth_.r)) {  // a gear's far side follows beyond the backlash
    const Sensor& sensor = truth_.sensor[k];
    if (!properties(sensor.kind).is_theta || sensor.eccentricity.gear == 1) continue;
    const double half = fabs(sensor.gain) * effects_.backlash / 2, near = q_e[n + k];
    q_e[n + k] = geared_[k] = clamp(geared_[k], near - half, near + half);
  }
  spoil(truth_, random_, q_e);
  return outcome;
}

void Plant::push(const Closure& closure, const DynamicModel& model, Joint& torque) const {
  Jacobians jacobians;
  if (!jacobian(closure, jacobians)) return;
  for (int i : range(n))
    for (int j : range(jacobians.n)) torque[i] += model.slope[i] * jacobians.J[j][i] * force_[j];
}

double Plant::brake_torque(int i) const {
  const double limit = truth_.chain[i].torque_limit;
  return limit > 0 ? limit : 2 * fabs(transmitted_[i]);
}

bool Plant::springy(int i) const {
  return effects_.arm_stiffness > 0 && truth_.chain[i].actuator == Actuator::revolute;
}

Joint Plant::transmitted(const Joint& q, const Joint& rate, const Joint& torque, const Rotors& y,
                         Rotors& dy) {
  for (int i : range(n)) {
    const double arm = shaft(i, q[i]);
    const double ripple = effects_.ripple * sin(kRipples * arm + effects_.phase[i]);
    const double turns = springy(i) ? y[n + i] : rate[i];
    const double holds = rubs_[i] + kBrakeDamping * turns / brake_gives_[i];
    const double rubs =
        effects_.friction[i] * slip_[i] + brake_[i] * (engaged_ ? holds : clamp(holds, -1.0, 1.0));
    const double net = torque[i] * (1 + ripple) - rubs;
    if (springy(i)) {  // the rotor turns against its arm's root
      const double k = effects_.arm_stiffness, I = rotor_[i];
      const double damping = 2 * effects_.arm_damping * sqrt(k * I);
      transmitted_[i] = k * (y[i] - arm) + damping * (y[n + i] - rate[i]);
      dy[i] = y[n + i];
      dy[n + i] = (net - transmitted_[i]) / I;
    } else {
      transmitted_[i] = net;
      dy[i] = rate[i];
      dy[n + i] = 0;
    }
  }
  return transmitted_;
}

Outcome Plant::bend(Robot& robot) const {
  Closure closure;
  const Outcome outcome = ikm(truth_, state_.pose, closure);
  if (!outcome) return outcome;
  const Joint q = closure.q();
  for (int i : range(n)) {
    const Chain& from = truth_.chain[i];
    const ChainState& at = closure.chain[i];
    const double gain = from.encoder_gain;
    if (springy(i)) robot.chain[i].encoder_offset -= gain * (rotors_[i] - shaft(i, q[i]));
    if (effects_.rod_stiffness <= 0) continue;
    const double carried =
        (from.actuator == Actuator::revolute ? 0.5 : 1) * from.arm_mass + 0.5 * from.rod_mass;
    const double left = transmitted_[i] + carried * truth_.gravity.dot(at.dB) / at.rate;
    const double length = at.v.norm();
    // With arm and rod in line the torque does not determine the rod's force.
    if (!(fabs(at.jq) > 1e-3 * length * at.dB.norm())) continue;
    const int rods = paired(truth_.mobility) ? 2 : 1;
    const double stretched = left * length * at.rate / at.jq / (rods * effects_.rod_stiffness);
    if (from.actuator == Actuator::telescopic)
      robot.chain[i].encoder_offset += gain * stretched;
    else
      robot.chain[i].rod += stretched;
  }
  return outcome;
}
}  // namespace truepose
