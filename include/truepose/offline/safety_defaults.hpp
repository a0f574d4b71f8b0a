// Limits of the safety shell from a robot and its controller, the needs of a path, and the distance
// of a stop.
#pragma once

#include "truepose/control/control.hpp"
#include "truepose/control/safety_shell.hpp"
#include "truepose/offline/fastest.hpp"

namespace truepose {
/// Position error of an uncalibrated robot, m (the paper's H4: 9 mm). Laws that correct it move the
/// motors off their nominal positions by its image.
inline constexpr Real kUncalibrated = 0.010;
/// Friction of motors whose robot file has none, over their torque limit (assumed).
inline constexpr Real kFriction = 0.03;

namespace safety_detail {
/// Model at home: K M⁻¹ Kᵀ and its relatives.
struct AtHome {
  Jacobians jacobians;
  Closure closure;
  DynamicModel model;
  Square inertia;  ///< of the motors

  Outcome find(const Robot& robot) {
    Outcome outcome = ikm(robot, to_pose(robot.mobility, robot.home), closure);
    if (outcome) outcome = jacobian(closure, jacobians);
    if (outcome) outcome = dynamic_model(robot, closure, Coordinates{}, model);
    if (outcome) inertia = joint_inertia(model, jacobians.J);
    return outcome;
  }
  /// Speed of the reference point (on passive axes: of the axes) per speed of a motor.
  Real lever(int motor) const {
    Real sum = 0;
    for (int j = 0; j < positions_of(closure.carried.mobility); ++j)
      sum += jacobians.J[j][motor] * jacobians.J[j][motor];
    return std::sqrt(sum);
  }
};

/// A motor's travel: between its stops; without stops a quarter turn, or the rod's length.
inline Real travel(const Chain& chain) {
  if (std::isfinite(chain.low) && std::isfinite(chain.high)) return chain.high - chain.low;
  if (chain.actuator == Actuator::revolute) return std::numbers::pi_v<Real> / 2;
  return chain.rod > 0 ? chain.rod : 1;
}
}  // namespace safety_detail

/// Limits of a robot whose motors all have a torque limit. Lengths and angles as the motors read,
/// all at home; I_i is motor i's own inertia, ω_i = √(kp_i/I_i) its loop's natural frequency.
///
///     torque      the motor's limit τ_i
///     slew        2 τ_i in 10 ms: the torque of a stop is reached from any other in that time; at
///                 least 2.5 times the loop's answer to a count of all motors, by kp and kd times
///                 the velocity filter's bandwidth (measured: up to 2.3); at most 2 τ_i in a period
///     tracking    τ_i / kp_i: the error by which kp_i alone asks for the whole torque
///     deviation   tracking; laws that correct the geometry: and 10 mm at the platform
///     speed       √(a_i s_i): from rest over half the travel s_i at a_i, the largest acceleration
/// count       one count, and 8 σ of the noise of a difference
///     window      count is at most a tenth of the speed limit over it; 8 ms at most
/// still       three times that: a reading, the measured pace, and the motor's dither by a count
/// rests       count, and the error at which the loops balance the friction of all motors: three
///             times the robot's, 3 % of τ_i where it has none
///     low, high   the stops, as read
///     saturation  5/ω, of the slowest motor: a loop leaves saturation in that time
///     standstill  speed_i I_i / τ_i, the longest: the brake rubs with τ_i (assumed)
///
/// @return no_such_value and the motor without a torque limit or gain
inline Outcome default_limits(const Robot& robot, const ControlSettings& settings,
                              SafetyLimits& limits) {
  const int n = dof(robot.mobility);
  safety_detail::AtHome home;
  Extended most{};
  Outcome outcome = home.find(robot);
  if (outcome) outcome = fastest(robot, robot.home, most);
  if (!outcome) return outcome;
  limits = {};
  limits.period = settings.period;

  const bool corrects = properties(settings.law).corrects != Corrects::motors;
  const bool shaped = settings.gains == Gains::inertia;
  Joint friction{};
  int window = 1;
  Real slowest = INFINITY, rest = 0;
  for (int i = 0; i < n; ++i) {
    const Chain& chain = robot.chain[i];
    const Real inertia = std::fabs(home.model.slope[i]) * home.inertia[i][i];
    const Real torque = chain.torque_limit;
    // Of an encoder that counts backwards both gains are negative.
    const Real kp = std::fabs(settings.kp[i]) * (shaped ? inertia : 1);
    if (!(torque > 0 && kp > 0 && inertia > 0)) return Outcome{Status::no_such_value, i};
    limits.torque[i] = torque;
    limits.slew[i] = 2 * torque / kReaction;
    limits.tracking[i] = torque / kp;
    limits.deviation[i] = limits.tracking[i] + (corrects ? kUncalibrated / home.lever(i) : 0);
    limits.speed[i] = std::sqrt(most[i] * safety_detail::travel(chain));
    limits.count[i] = chain.encoder_step + 8 * std::sqrt(2.0) * chain.encoder_noise;
    limits.count[i] += by_precision(1e-9, 1e-5);  // rounding
    const Real per_cycle = 0.1 * limits.speed[i] * settings.period;
    window = std::max(
        window,
        static_cast<int>(std::ceil(std::min<Real>(limits.count[i] / per_cycle, kMostWindow))));
    limits.still[i] = 3 * limits.count[i];
    limits.kp[i] = kp / inertia;
    limits.kd[i] = std::fabs(settings.kd[i]) / (shaped ? 1 : inertia);
    friction[i] = chain.coulomb > 0 ? 3 * chain.coulomb : kFriction * torque;
    limits.rests[i] = limits.count[i] + (shaped ? 0 : friction[i] / kp);
    if (std::isfinite(chain.low) && std::isfinite(chain.high)) {
      const Real low = motor_reading(chain, chain.low), high = motor_reading(chain, chain.high);
      limits.low[i] = std::min(low, high) - limits.count[i];
      limits.high[i] = std::max(low, high) + limits.count[i];
    }
    slowest = std::min(slowest, std::sqrt(kp / inertia));
    rest = std::max(rest, limits.speed[i] * inertia / torque);
  }
  Coordinates size;
  for (int i = 0; i < n; ++i) size[i] = home.inertia[i][i];
  const Ldlt factor(n, home.inertia, size);
  for (int j = 0; j < n && shaped; ++j) {  // one motor's friction moves the others, too
    Coordinates error{};
    error[j] = friction[j] / home.model.slope[j];
    factor.solve(error);
    for (int i = 0; i < n; ++i) limits.rests[i] += std::fabs(error[i] / settings.kp[i]);
  }
  for (int i = 0; i < n; ++i) {
    const Real answer = sum_of(n, [&](int j) {
      if (j != i && !shaped) return Real{0};
      return std::fabs(home.model.slope[i] * home.inertia[i][j]) * limits.count[j] *
             (limits.kp[j] + limits.kd[j] * settings.velocity_bandwidth);
    });
    const Real step = std::min(2.5 * answer, 2 * limits.torque[i]);
    limits.slew[i] = std::max(limits.slew[i], step / settings.period);
  }
  const int longest = static_cast<int>(0.008 / settings.period + 1e-6);
  limits.window = std::clamp(window, 1, std::max(1, std::min(longest, kMostWindow)));
  limits.age = std::clamp(static_cast<int>(kReaction / settings.period), 1, 2);
  limits.saturation = std::max(5 / slowest, settings.period);
  limits.standstill = std::max(rest, settings.period);
  return consistent(limits, n, n);
}

namespace safety_detail {
/// Frozen cycles until the loop opens, and the speed and way of the platform by the loop until
/// then, without a mark of the frames. @param pace  of the motor that is fastest in counts, over
/// its `still`
struct Unmarked {
  int cycles = 0;
  Real gained = 0, way = 0;
  Unmarked(const SafetyLimits& limits, Real kp, Real kd, Real speed, Real pace, Real rests) {
    const Real T = limits.period;
    Real error = 0, pushed = 0, seen = 0;  // of that motor
    while (cycles < kLongest && seen <= 1 && !(pace > kLeastPace && pace * (cycles + 1) > 1)) {
      ++cycles;
      const Real next = std::max(pace * cycles - rests, Real{0});
      pushed += T * kp * next + kd * (next - error);
      seen += T * pushed;
      error = next;
      gained += T * (kp * cycles * T + kd) * speed;
      way += T * gained;
    }
  }
};

/// Least speed of the fastest motor over its `still`, per speed of the platform: of 13 directions.
inline Real least_pace(const Robot& robot, const DynamicModel& model, const SafetyLimits& limits) {
  Real least = INFINITY;
  for (int direction = 1; direction < 27; ++direction) {
    std::array<Real, 3> d{};
    Real size = 0, most = 0;
    for (int j = 0, code = direction; j < positions_of(robot.mobility); ++j, code /= 3) {
      d[j] = code % 3 - 1;
      size += d[j] * d[j];
    }
    if (size == 0) continue;
    for (int i = 0; i < dof(robot.mobility); ++i) {
      Real rate = 0;
      for (int j = 0; j < positions_of(robot.mobility); ++j) rate += model.k[i][j] * d[j];
      most = std::max(most, std::fabs(rate) / limits.still[i] / std::sqrt(size));
    }
    least = std::min(least, most);
  }
  return least;
}
}  // namespace safety_detail

/// Distance of the reference point, m, from the last fresh frame before a common fault of all
/// readings to standstill, at home, at a speed (m/s; on passive axes rad and rad/s):
///
///     v (t + T)                  t: until the fault is detected; T: until the brakes are told
///     v brake                    the brakes close
///     ½ v² λ max_i(|J_i|/τ_i)    they do the work Σ τ_i |Δq_i|, and |Δx| ≤ Σ |J_i| |Δq_i|
///
/// with λ a bound of the platform's apparent mass, J_i column i of J (its position rows). By one
/// count a loop changes its motor's speed by kd times the count, which adds to v. Frames with a
/// counter or timestamp are detected as `age` allows. Without one, a motor first has to stand still
/// where it should not. Until then the loop takes the setpoint's way v t for an error: the speed
/// grows by kd v t + kp v t²/2. Slower motion is detected later, and the distance may be larger.
/// @param marked  frames carry a counter or timestamp
inline Outcome stopping_distance(const Robot& robot, const SafetyLimits& limits, bool marked,
                                 Real speed, Real& distance) {
  using namespace safety_detail;
  AtHome home;
  const Outcome outcome = home.find(robot);
  if (!outcome) return outcome;
  Real mass = 0, per_work = 0, kp = 0, kd = 0, dither = 0, rests = 0;
  for (int j = 0; j < positions_of(robot.mobility); ++j)  // Gershgorin
    mass = std::max(
        mass, sum_of(positions_of(robot.mobility), [&](int l) { return std::fabs(home.model.mass[j][l]); }));
  for (int i = 0; i < dof(robot.mobility); ++i) {
    per_work = std::max(per_work, home.lever(i) / limits.torque[i]);
    kp = std::max(kp, limits.kp[i]);
    kd = std::max(kd, limits.kd[i]);
    dither = std::max(dither, limits.kd[i] * limits.count[i] * home.lever(i));
    rests = std::max(rests, limits.rests[i] / limits.still[i]);
  }
  const Real T = limits.period, least = least_pace(robot, home.model, limits);
  int named = limits.age + 1;
  Real way = 0, gained = 0;
  if (!marked) {
    const Unmarked frozen(limits, kp, kd, speed, T * speed * least, rests);
    named = std::max(frozen.cycles + 1, kFrozen);
    gained = frozen.gained;
    way = frozen.way + gained * T * (named - frozen.cycles);
  }
  speed += dither;
  const Real last = speed + gained;
  distance =
      way + speed * named * T + last * (T + limits.brake) + 0.5 * last * last * mass * per_work;
  return outcome;
}

/// What a path asks of the motors.
struct PathNeeds {
  Joint speed{}, torque{}, slew{};
  Joint last{};  ///< torque of the last setpoint
  Coordinates low{}, high{};
  bool begun = false;
};

/// Adds the next setpoint of a path. @return the inverse model's and dynamics' failures
inline Outcome include(const Robot& robot, Real period, const Setpoint& setpoint,
                       PathNeeds& needs) {
  Closure closure;
  Jacobians jacobians;
  Joint torque{};
  Outcome outcome = ikm(robot, to_pose(robot.mobility, setpoint.x), closure);
  if (outcome) outcome = jacobian(closure, jacobians);
  if (outcome)
    outcome = inverse_dynamics(robot, to_pose(robot.mobility, setpoint.x), setpoint.rate,
                                  setpoint.acceleration, torque);
  if (!outcome) return outcome;
  const Joint rate = jacobians.joint_rate(setpoint.rate);
  for (int i = 0; i < dof(robot.mobility); ++i) {
    needs.speed[i] = std::max(needs.speed[i], std::fabs(rate[i]));
    needs.torque[i] = std::max(needs.torque[i], std::fabs(torque[i]));
    if (needs.begun)
      needs.slew[i] = std::max(needs.slew[i], std::fabs(torque[i] - needs.last[i]) / period);
    needs.last[i] = torque[i];
    needs.low[i] = needs.begun ? std::min(needs.low[i], setpoint.x[i]) : setpoint.x[i];
    needs.high[i] = needs.begun ? std::max(needs.high[i], setpoint.x[i]) : setpoint.x[i];
  }
  needs.begun = true;
  return outcome;
}

/// Compares limits with themselves and with a path, before anything moves.
/// @return no_such_value and the motor whose limit is below what the path needs; -1: the box
inline Outcome contradiction(const Robot& robot, const SafetyLimits& limits,
                             const PathNeeds& needs) {
  const int n = dof(robot.mobility);
  const Outcome own = consistent(limits, n, n);
  if (!own) return own;
  for (int i = 0; i < n; ++i) {
    if (!(needs.speed[i] <= limits.speed[i] && needs.torque[i] <= limits.torque[i] &&
          needs.slew[i] <= limits.slew[i]))
      return {Status::no_such_value, i};
    const bool boxed = limits.box_low[i] < limits.box_high[i];
    if (boxed && !(needs.low[i] >= limits.box_low[i] && needs.high[i] <= limits.box_high[i]))
      return {Status::no_such_value, -1};
  }
  return own;
}
}  // namespace truepose
