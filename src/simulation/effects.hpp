// Physical effects of the exact plant that the model omits: friction, compliance, backlash, ripple.
//
// Thermal growth, eccentric encoders and quantization are parameters of the true robot.
#pragma once

#include <algorithm>

#include "control/momentum_observer.hpp"
#include "simulation/plant.hpp"

namespace truepose {
/// Effects; zero disables an effect.
struct Effects {
  double backlash = 0;        ///< full backlash of a geared platform angle's gear, rad of the angle
  Joint friction{};           ///< Coulomb friction at each motor, N·m or N
  double presliding = 1e-4;   ///< reversal distance of friction, rad or m of the motor
  double arm_stiffness = 0;   ///< of an arm at its root, N·m/rad (0: rigid)
  double arm_damping = 0.05;  ///< of the rotor against its arm, ratio
  double rod_stiffness = 0;   ///< of one rod along its axis, N/m (0: rigid)
  double ripple = 0;          ///< relative amplitude of a motor's torque ripple
  Joint phase{};              ///< of the ripple, rad
  bool delayed = false;       ///< a torque acts one cycle after its readings

  bool change_torque() const {
    return ripple > 0 || arm_stiffness > 0 ||
           std::ranges::any_of(friction, [](double f) { return f > 0; });
  }
  bool give_way() const { return arm_stiffness > 0 || rod_stiffness > 0; }
};

inline constexpr double kRipples = 6;             ///< periods per turn of a motor
inline constexpr double kBrakeCloses = 0.02;      ///< closing time of a brake, s; assumed
inline constexpr double kBrakePresliding = 1e-3;  ///< of a closed brake, rad or m; assumed
inline constexpr double kBrakeDamping = 1e-3;     ///< s, by which it comes to rest; assumed
inline constexpr double kSlideGives = 1e-4;       ///< of that of a slide after engage(), m; assumed
inline constexpr int kCompliantSteps = 4;         ///< minimum per control period: rotors oscillate

/// A disturbance of the plant.
struct Event {
  Disturbance kind = Disturbance::payload;
  double begin = 0;                                      ///< s
  double end = std::numeric_limits<double>::infinity();  ///< s; of a contact
  int motor = 0;                                         ///< of friction
  double size = 0;      ///< mass at D, kg; or additional Coulomb friction, N·m or N
  Coordinates force{};  ///< of a contact, of the platform's coordinates, N and N·m
};

/// Dahl friction after a displacement: df/dq = (sgn dq - f)/presliding, exact solution. It depends
/// on the path only, not on time: a motor at rest stays, one that reverses lags. (P. R. Dahl, A
/// solid friction model, Aerospace Corporation TOR-0158, 1968.)
inline double dahl(double slip, double displacement, double presliding) {
  const double side = displacement > 0 ? 1 : -1;
  return side + (slip - side) * std::exp(-std::fabs(displacement) / presliding);
}

/// The true robot and its state: pose, rate, friction, rotors, gears.
class Plant {
 public:
  /// Angles, then from n on their rates.
  using Rotors = std::array<double, 2 * kMaxMotors>;

  Plant(const Robot& truth, const Effects& effects, const Pose& start, std::uint64_t seed)
      : truth_(truth),
        n(dof(truth.mobility)),
        driven_(truth),
        effects_(effects),
        state_{start, {}},
        random_(seed) {
    brake_gives_.fill(kBrakePresliding);
    for (int i = 0; i < n; ++i) {  // the robot file has rotor and arm as one inertia
      const Chain& chain = truth.chain[i];
      rotor_[i] = std::max(chain.drive_inertia - chain.arm_mass * chain.arm * chain.arm / 3,
                           0.1 * chain.drive_inertia);
      if (springy(i)) driven_.chain[i].drive_inertia -= rotor_[i];
    }
  }

  const Pose& pose() const { return state_.pose; }

  /// Initialises the plant at rest under its own weight.
  Outcome rest() {
    Closure closure;
    Outcome outcome = ikm(truth_, state_.pose, closure);
    if (outcome) outcome = hold(truth_, state_.pose, transmitted_);
    if (!outcome) return outcome;
    const Joint q = closure.q();
    for (int i = 0; i < n; ++i)
      rotors_[i] = shaft(i, q[i]) + (springy(i) ? transmitted_[i] / effects_.arm_stiffness : 0);
    Extended q_e{};
    outcome = exact_readings(truth_, state_.pose, q_e, rest_);
    for (int k = 0; k < truth_.r; ++k) geared_[k] = q_e[n + k];
    return outcome;
  }

  /// Applies the brakes requested as bits from kBrakeCloses on; others open. Each rubs with its
  /// motor's largest torque (assumed); without a torque limit it only holds its load.
  void brake(std::uint32_t motors, double period) {
    for (int i = 0; i < n; ++i) {
      closing_[i] = motors >> i & 1U ? closing_[i] + period : 0;
      if (closing_[i] == 0) brake_[i] = 0;
      if (closing_[i] > kBrakeCloses) brake_[i] = brake_torque(i);
    }
  }

  /// Begins a disturbance. A contact lasts until its negative force is added.
  void disturb(const Event& event, double sign = 1) {
    if (event.kind == Disturbance::payload && driven_.bodies < kMaxBodies) {
      driven_.body[driven_.bodies] = Body{};
      driven_.body[driven_.bodies++].mass = event.size;
    }
    if (event.kind == Disturbance::friction) effects_.friction[event.motor] += event.size;
    for (int j = 0; j < n && event.kind == Disturbance::contact; ++j)
      force_[j] += sign * event.force[j];
    pushed_ = std::ranges::any_of(force_, [](double f) { return f != 0; });
  }

  /// Closes all brakes of a robot at rest, which carry its weight.
  void engage() {
    for (int i = 0; i < n; ++i) {
      brake_[i] = brake_torque(i);
      if (truth_.chain[i].actuator != Actuator::revolute) brake_gives_[i] = kSlideGives;
      rubs_[i] = brake_[i] > 0 ? std::clamp(-transmitted_[i] / brake_[i], -1.0, 1.0) : 0;
    }
    asked_ = ~0U;
    engaged_ = true;
  }

  /// After engage(): applies brakes, as bits, that open and close after delays, s.
  void work_brakes(std::uint32_t motors, double period, double opens = kBrakeCloses,
                   double closes = kBrakeCloses) {
    clock_ += period;
    for (int i = 0; i < n; ++i) {
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

  /// Advances one period under constant torque commands.
  /// @return unreachable or singular where the robot leaves its workspace
  Outcome advance(const Joint& torque, double period, int steps) {
    const bool braked = std::ranges::any_of(brake_, [](double torque) { return torque > 0; });
    if (!effects_.change_torque() && !braked && !pushed_) {
      transmitted_ = torque;
      return truepose::advance(driven_, torque, period, steps, state_);
    }
    if (effects_.arm_stiffness > 0 || braked) steps = std::max(steps, kCompliantSteps);
    if (engaged_) steps = std::max(steps, 2 * kCompliantSteps);
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
      for (int i = 0; i < n; ++i) {
        const double moved_by = turned[i] - rotors_[i];
        if (moved_by == 0) continue;
        slip_[i] = dahl(slip_[i], moved_by, effects_.presliding);
        // Dahl's friction creeps under a load that swings; a brake at rest does not.
        rubs_[i] = engaged_ ? std::clamp(rubs_[i] + moved_by / brake_gives_[i], -1.0, 1.0)
                            : dahl(rubs_[i], moved_by, brake_gives_[i]);
      }
      rotors_ = turned;
    }
    return {};
  }

  /// Encoder readings of the deflected robot; a geared platform angle reads behind its gear.
  Outcome measure(Extended& q_e) {
    Outcome outcome;
    if (effects_.give_way()) {
      Robot robot = truth_;
      outcome = bend(robot);
      if (outcome) outcome = exact_readings(robot, state_.pose, q_e, rest_);
    } else {
      outcome = exact_readings(truth_, state_.pose, q_e, rest_);
    }
    if (!outcome) return outcome;
    for (int k = 0; k < truth_.r; ++k) {  // a gear's far side follows beyond the backlash
      const Sensor& sensor = truth_.sensor[k];
      if (!properties(sensor.kind).is_theta || sensor.eccentricity.gear == 1) continue;
      const double half = std::fabs(sensor.gain) * effects_.backlash / 2, near = q_e[n + k];
      q_e[n + k] = geared_[k] = std::clamp(geared_[k], near - half, near + half);
    }
    spoil(truth_, random_, q_e);
    return outcome;
  }

 private:
  /// Adds the motor torques that equal the contacts' force, Jᵀ f.
  void push(const Closure& closure, const DynamicModel& model, Joint& torque) const {
    Jacobians jacobians;
    if (!jacobian(closure, jacobians)) return;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) torque[i] += model.slope[i] * jacobians.J[j][i] * force_[j];
  }

  double brake_torque(int i) const {
    const double limit = truth_.chain[i].torque_limit;
    return limit > 0 ? limit : 2 * std::fabs(transmitted_[i]);
  }

  bool springy(int i) const {
    return effects_.arm_stiffness > 0 && truth_.chain[i].actuator == Actuator::revolute;
  }

  /// Motor angle or slide from a reading, without correction of offset and eccentricity.
  double shaft(int i, double q) const { return q / truth_.chain[i].encoder_gain; }

  /// Torque transmitted to the arms, and the derivatives of the rotors' angles and rates.
  Joint transmitted(const Joint& q, const Coordinates& rate, const Joint& torque, const Rotors& y,
                    Rotors& dy) {
    for (int i = 0; i < n; ++i) {
      const double arm = shaft(i, q[i]);
      const double ripple = effects_.ripple * std::sin(kRipples * arm + effects_.phase[i]);
      const double turns = springy(i) ? y[n + i] : rate[i];
      const double holds = rubs_[i] + kBrakeDamping * turns / brake_gives_[i];
      const double rubs = effects_.friction[i] * slip_[i] +
                          brake_[i] * (engaged_ ? holds : std::clamp(holds, -1.0, 1.0));
      const double net = torque[i] * (1 + ripple) - rubs;
      if (springy(i)) {  // the rotor turns against its arm's root
        const double k = effects_.arm_stiffness, I = rotor_[i];
        const double damping = 2 * effects_.arm_damping * std::sqrt(k * I);
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

  /// Applies the deflection of arms and (quasi-static) rods as geometry. The torque at an arm's
  /// root, minus the weight of arm and half its rods, equals the rods' tension T times J_q/L.
  Outcome bend(Robot& robot) const {
    Closure closure;
    const Outcome outcome = ikm(truth_, state_.pose, closure);
    if (!outcome) return outcome;
    const Joint q = closure.q();
    for (int i = 0; i < n; ++i) {
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
      if (!(std::fabs(at.jq) > 1e-3 * length * at.dB.norm())) continue;
      const int rods = paired(truth_.mobility) ? 2 : 1;
      const double stretched = left * length * at.rate / at.jq / (rods * effects_.rod_stiffness);
      if (from.actuator == Actuator::telescopic)
        robot.chain[i].encoder_offset += gain * stretched;
      else
        robot.chain[i].rod += stretched;
    }
    return outcome;
  }

  const Robot& truth_;
  const int n;
  Robot driven_;  ///< without the inertia of rotors on elastic arms
  Effects effects_;
  PlantState state_;
  Parasitic rest_;  ///< start of the rods' next solution
  Joint rotor_{};   ///< rotor inertia
  Rotors rotors_{};
  Joint slip_{}, rubs_{};      ///< friction and brake, relative to their maxima, -1 to 1
  Coordinates force_{};        ///< of contacts
  bool pushed_ = false;        ///< it is not 0
  Joint closing_{}, brake_{};  ///< s since brakes were requested; their torque
  Joint brake_gives_{};        ///< presliding of brakes, rad or m
  std::uint32_t asked_ = 0;    ///< of work_brakes(): brakes as last requested,
  bool engaged_ = false;       ///< by engage()
  double clock_ = 0;           ///< s,
  Joint opens_{}, closes_{};   ///< and when they follow; 0: they have
  Joint transmitted_{};        ///< torque transmitted to the arms
  std::array<double, kMaxSensors> geared_{};  ///< far sides of geared sensors, as read
  Random random_;
};
}  // namespace truepose
