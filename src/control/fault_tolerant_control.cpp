// The fault-tolerant controller: fault monitor, law, stop and brakes.
#include "control/fault_tolerant_control.hpp"

namespace truepose {
void PathClock::advance(Real period, Real stop) {
  if (stop > 0 && rate > 0) {
    since = min(since + period / stop, Real{1});
    const Real next = 1 - since * since * (3 - 2 * since);  // smooth at both ends
    slowing = (next - rate) / period;
    time += 0.5 * (rate + next) * period;
    rate = next;
  } else {
    slowing = 0;
    time += rate * period;
  }
}

Setpoint PathClock::paced(Setpoint at) const {
  for (std::size_t i = 0; i < at.rate.size(); ++i) {
    at.acceleration[i] = at.acceleration[i] * rate * rate + at.rate[i] * slowing;
    at.rate[i] *= rate;
  }
  return at;
}

void acknowledge(FaultTolerantState& fault_state, int reading) {
  acknowledge(fault_state.monitor, reading);
  release(fault_state);
}

namespace {
/// Violations after which no motor can be trusted.
constexpr std::uint32_t kUntrusted = bit_of(StopCause::clock_backwards) |
                                     bit_of(StopCause::dropped_frames) |
                                     bit_of(StopCause::stale_frame) | bit_of(StopCause::overspeed);

/// Checks the cycle against the limits, without the readings that the monitor excludes.
/// @param applied  torques of the last cycle
void check(const Robot& robot, const SafetyLimits& limits, const Setpoint& setpoint,
           const Extended& q_e, Outcome answer, const ControlState& state, const Joint& applied,
           FaultTolerantState& fault_state) {
  const int n = robot.motors;
  const FaultMonitor& monitor = fault_state.monitor;
  const CheckedCycle cycle{setpoint.x,       state.q_d,   motors_of(robot, q_e), answer,
                           state.torque,     state.error, fault_state.frame,     {},
                           monitor.unused(n)};
  Violations found =
      check_limits(n, dof(robot.mobility), limits, cycle, fault_state.asked && !fault_state.brakes,
                   applied, fault_state.checked);
  found.causes &= kUntrusted;
  if (!found.causes) return;
  if (fault_state.cause == StopCause::none) {
    fault_state.cause = found.first();
    fault_state.part = found.part[std::size_t(fault_state.cause)];
  }
  fault_state.stops = true;
  fault_state.brakes = bit(n) - 1;
}
}  // namespace

Outcome control_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                               const FaultTolerantSettings& fault_settings,
                               const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                               const Weighing& weighing, FaultTolerantState& fault_state,
                               Multirate* late) {
  const int n = robot.motors;
  const Joint applied = state.torque;
  Extended believed = q_e;
  FaultMonitor& monitor = fault_state.monitor;
  const Outcome monitored = monitor_faults(
      fault_settings.finest ? *fault_settings.finest : robot, fault_settings.monitor, weighing,
      fault_state.asked ? fault_state.q_d : motors_of(robot, q_e), q_e, monitor, believed, late);
  Supervisor* const supervisor = fault_settings.supervisor;
  if (supervisor)
    supervisor->observe(robot, settings.period, monitored && state.started && !fault_state.stops,
                        state.torque, monitor);
  const std::uint32_t all = bit(n) - 1;
  const bool held = fault_state.brakes == all;
  fault_state.stops = fault_state.stops || monitor.undecided || monitor.lost != 0;
  fault_state.brakes |= monitor.lost;
  // While the fault is undecided, no loop stays closed longer than the stop takes.
  if (monitor.undecided) fault_state.stopping += settings.period;
  if (fault_state.stopping > fault_settings.monitor.stop) fault_state.brakes = all;
  state.switched = state.switched || state.braked != fault_state.brakes;
  state.braked = fault_state.brakes;
  Outcome outcome = monitored;
  if (monitored) {
    ControlSettings now = settings;
    const std::uint32_t failed = monitor.failed(n + robot.r);
    const bool reweigh = failed || late;
    if (reweigh) fault_state.known = *weighing.known;
    // A lost motor counts as being at its setpoint: a law that weighs would estimate its error from
    // readings that hardly determine it, and drive it by that.
    for (int c = 0; c < n + robot.r && failed; ++c)
      if (failed & ~monitor.lost & bit(c)) fault_state.known.sigma[c] *= kDisbelieved;
    if (late) {
      low_pass(robot, *late, believed, failed & (bit(n) - 1));
      weigh(robot, *late, fault_state.known);
    }
    if (failed && !(~failed & (bit(n + robot.r) - bit(n)))) now.law = Law::joint;
    state.switched = state.switched || monitor.changed;
    const Weighing reweighed{&fault_state.known, weighing.work, weighing.kept};
    outcome = control(robot, now, setpoint, believed, state, reweigh ? reweighed : weighing);
  }
  if (outcome && supervisor) supervisor->answered(robot, setpoint, state.torque);
  if (outcome) fault_state.q_d = state.q_d;
  fault_state.asked = fault_state.asked || outcome;
  fault_state.unanswered = outcome ? 0 : fault_state.unanswered + settings.period;
  if (fault_settings.limited)
    check(robot, fault_settings.limits, setpoint, q_e, outcome, state, applied, fault_state);
  if (fault_state.unanswered > fault_settings.monitor.held) {
    fault_state.stops = true;
    fault_state.brakes = all;
  }
  if (fault_state.stops)
    fault_state.stop =
        monitor.lost ? fault_settings.monitor.stop_lost : fault_settings.monitor.stop;
  if (fault_state.brakes == all) {
    if (!held &&
        (!state.started || !inverse_dynamics(robot, to_pose(robot.mobility, fault_state.at), {}, {},
                                             fault_state.weight)))
      fault_state.weight = {};
    for (int i : range(n)) state.torque[i] = limited(robot.chain[i], fault_state.weight[i]);
    state.error = state.error_rate = state.integral = {};  // blends in after acknowledge()
  } else if (outcome) {
    fault_state.at = setpoint.x;
  } else {  // hold the last torques, without the PD of a motor lost now
    for (int i : range(n))
      if (fault_state.brakes & bit(i)) state.torque[i] = limited(robot.chain[i], state.load[i]);
  }
  return outcome && monitored.status == Status::disagree ? monitored : outcome;
}
}  // namespace truepose
