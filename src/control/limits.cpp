// Limits of a control cycle: contradictions in themselves, and torques within them.
#include "control/limits.hpp"

namespace truepose {
Outcome consistent(const SafetyLimits& limits, int motors, int freedoms) {
  const auto positive = [](Real value) { return value > 0 && value < INFINITY; };
  const auto within = [](Real least, Real value, Real most) {
    return value >= least && value <= most;
  };
  const SafetyLimits& l = limits;
  const Real T = l.period;
  bool good = positive(T) && positive(l.stop) && positive(l.standstill) && l.brake >= 0 &&
              positive(l.standstill + l.brake) && l.saturation >= T && l.clipped >= T;
  good = good && within(0, l.missing, kReaction) && within(0, l.held, kReaction) &&
         within(1, l.window, kMostWindow) && within(T, l.age * T, kReaction) &&
         within(2, l.counter_bits, 64);
  for (int j : range(freedoms)) good = good && l.box_low[j] <= l.box_high[j];
  if (!good) return {Status::no_such_value};
  for (int i : range(motors)) {
    good = positive(l.torque[i]) && positive(l.slew[i]) && positive(l.speed[i]);
    // The stop's torque is reached from any other within the reaction time.
    good = good && 2 * l.torque[i] <= l.slew[i] * kReaction * (1 + by_precision(1e-9, 1e-5));
    // One count is no violation.
    good = good && l.count[i] >= 0 && l.tracking[i] > l.count[i] && l.tracking[i] < INFINITY &&
           l.deviation[i] >= l.tracking[i] && l.deviation[i] < INFINITY;
    good = good && l.still[i] > l.count[i] && l.still[i] < INFINITY && l.kp[i] >= 0 &&
           l.kd[i] >= 0 && l.rests[i] >= 0 && l.low[i] <= l.high[i];
    if (!good) return {Status::no_such_value, i};
  }
  return {};
}

bool approach(const SafetyLimits& limits, int motors, const Joint& target, Joint& torque) {
  bool reached = true;
  for (int i : range(motors)) {
    const Real most = max(Real{0}, limits.torque[i]);  // also of NaN
    const Real step = max(Real{0}, limits.slew[i] * limits.period);
    const Real now = torque[i];
    const Real bounded = clamp(isfinite(target[i]) ? target[i] : now, -most, most);
    const Real way = bounded - now;  // exact where it ends, no sum of roundings
    torque[i] = fabs(way) <= step ? bounded : now + copysign(step, way);
    reached = reached && torque[i] == bounded;
  }
  return reached;
}
}  // namespace truepose
