// Limits of a control cycle from a robot and its controller, and the distance of a stop.
#include "control/limit_defaults.hpp"

namespace truepose {
namespace {
using namespace safety_detail;

/// A motor's travel: between its stops; without stops a quarter turn, or the rod's length.
Real travel(const Chain& chain) {
  if (isfinite(chain.low) && isfinite(chain.high)) return chain.high - chain.low;
  if (chain.actuator == Actuator::revolute) return kPi / 2;
  return chain.rod > 0 ? chain.rod : 1;
}
/// Least speed of the fastest motor over its `still`, per speed of the platform: of 13 directions.
Real least_pace(const Robot& robot, const DynamicModel& model, const SafetyLimits& limits) {
  Real least = INFINITY;
  for (int direction : range(1, 27)) {
    std::array<Real, 3> d{};
    Real size = 0, most = 0;
    for (int j = 0, code = direction; j < positions_of(robot.mobility); ++j, code /= 3) {
      d[j] = code % 3 - 1;
      size += d[j] * d[j];
    }
    if (size == 0) continue;
    for (int i : range(robot.motors)) {
      Real rate = 0;
      for (int j : range(positions_of(robot.mobility))) rate += model.k[i][j] * d[j];
      most = max(most, fabs(rate) / limits.still[i] / sqrt(size));
    }
    least = min(least, most);
  }
  return least;
}
}  // namespace

Outcome default_limits(const Robot& robot, const ControlSettings& settings, SafetyLimits& limits) {
  const int n = dof(robot.mobility), motors = robot.motors;
  AtRest home;
  Extended most{};
  Outcome outcome = home.find(robot, to_pose(robot.mobility, robot.home));
  if (outcome) outcome = fastest(robot, robot.home, most);
  if (!outcome) return outcome;
  limits = {};
  limits.period = settings.period;

  const bool corrects = properties(settings.law).corrects != Corrects::motors;
  const bool shaped = settings.gains == Gains::inertia;
  Joint friction{};
  int window = 1;
  Real slowest = INFINITY, rest = 0;
  for (int i : range(motors)) {
    const Chain& chain = robot.chain[i];
    const Real inertia = fabs(home.model.slope[i]) * home.inertia[i][i];
    const Real torque = chain.torque_limit;
    // Of an encoder that counts backwards both gains are negative.
    const Real kp = fabs(settings.kp[i]) * (shaped ? inertia : 1);
    if (!(torque > 0 && kp > 0 && inertia > 0)) return Outcome{Status::no_such_value, i};
    limits.torque[i] = torque;
    limits.slew[i] = 2 * torque / kReaction;
    limits.tracking[i] = torque / kp;
    limits.deviation[i] = limits.tracking[i] + (corrects ? kUncalibrated / home.lever(i) : 0);
    limits.speed[i] = sqrt(most[i] * travel(chain));
    limits.count[i] = chain.encoder_step + 8 * sqrt(2.0) * chain.encoder_noise;
    limits.count[i] += by_precision(1e-9, 1e-5);  // rounding
    const Real per_cycle = 0.1 * limits.speed[i] * settings.period;
    window = max(window, int(std::ceil(min<Real>(limits.count[i] / per_cycle, kMostWindow))));
    limits.still[i] = 3 * limits.count[i];
    limits.kp[i] = kp / inertia;
    limits.kd[i] = fabs(settings.kd[i]) / (shaped ? 1 : inertia);
    friction[i] = chain.coulomb > 0 ? 3 * chain.coulomb : kFriction * torque;
    limits.rests[i] = limits.count[i] + (shaped ? 0 : friction[i] / kp);
    if (isfinite(chain.low) && isfinite(chain.high)) {
      const Real low = motor_reading(chain, chain.low), high = motor_reading(chain, chain.high);
      limits.low[i] = min(low, high) - limits.count[i];
      limits.high[i] = max(low, high) + limits.count[i];
    }
    slowest = min(slowest, sqrt(kp / inertia));
    rest = max(rest, limits.speed[i] * inertia / torque);
  }
  Extended rubbed{};  // one motor's friction moves the others, too
  if (shaped) outcome = fastest_under(robot, robot.home, friction, 0, rubbed);
  if (!outcome) return outcome;
  for (int i = 0; i < motors && shaped; ++i) limits.rests[i] += rubbed[i] / fabs(settings.kp[i]);
  for (int i : range(motors)) {
    const Real answer = sum_of(motors, [&](int j) {
      if (j != i && !shaped) return Real{0};
      return fabs(home.model.slope[i] * home.inertia[i][j]) * limits.count[j] *
             (limits.kp[j] + limits.kd[j] * settings.velocity_bandwidth);
    });
    const Real step = min(2.5 * answer, 2 * limits.torque[i]);
    limits.slew[i] = max(limits.slew[i], step / settings.period);
  }
  const int longest = int(0.008 / settings.period + 1e-6);
  limits.window = clamp(window, 1, max(1, min(longest, kMostWindow)));
  limits.age = clamp(int(kReaction / settings.period), 1, 2);
  limits.saturation = max(5 / slowest, settings.period);
  limits.standstill = max(rest, settings.period);
  return consistent(limits, motors, n);
}

Outcome stopping_distance(const Robot& robot, const SafetyLimits& limits, bool marked, Real speed,
                          Real& distance) {
  AtRest home;
  const Outcome outcome = home.find(robot, to_pose(robot.mobility, robot.home));
  if (!outcome) return outcome;
  Real mass = 0, per_work = 0, kp = 0, kd = 0, dither = 0, rests = 0;
  for (int j : range(positions_of(robot.mobility)))  // Gershgorin
    mass = max(mass, sum_of(positions_of(robot.mobility),
                            [&](int l) { return fabs(home.model.mass[j][l]); }));
  for (int i : range(robot.motors)) {
    per_work = max(per_work, home.lever(i) / limits.torque[i]);
    kp = max(kp, limits.kp[i]);
    kd = max(kd, limits.kd[i]);
    dither = max(dither, limits.kd[i] * limits.count[i] * home.lever(i));
    rests = max(rests, limits.rests[i] / limits.still[i]);
  }
  const Real T = limits.period;
  int named = limits.age + 1;
  Real way = 0, gained = 0;
  if (!marked) {  // the loop takes the setpoint's way for an error until it opens
    const Real pace = T * speed * least_pace(robot, home.model, limits);
    Real error = 0, pushed = 0, seen = 0;  // of the motor that is fastest in counts, over its still
    int cycles = 0;
    while (cycles < kMostCounted && seen <= 1 && !(pace > kLeastPace && pace * (cycles + 1) > 1)) {
      ++cycles;
      const Real next = max(pace * cycles - rests, Real{0});
      pushed += T * kp * next + kd * (next - error);
      seen += T * pushed;
      error = next;
      gained += T * (kp * cycles * T + kd) * speed;
      way += T * gained;
    }
    named = max(cycles + 1, kFrozen);
    way += gained * T * (named - cycles);
  }
  speed += dither;
  const Real last = speed + gained;
  distance =
      way + speed * named * T + last * (T + limits.brake) + 0.5 * last * last * mass * per_work;
  return outcome;
}
}  // namespace truepose
