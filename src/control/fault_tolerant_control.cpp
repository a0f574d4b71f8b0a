// The fault-tolerant controller: fault monitor, law, stop and brakes.
#include "control/fault_tolerant_control.hpp"

namespace truepose {
void PathClock::advance(Real period, Real stop) {
  if (stop > 0 && rate > 0) {
    since = std::min(since + period / stop, Real{1});
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

Outcome control_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                               const FaultTolerantSettings& fault_settings,
                               const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                               const Weighing& weighing, FaultTolerantState& fault_state,
                               Multirate* late) {
  const int n = robot.motors;
  Extended believed = q_e;
  FaultMonitor& monitor = fault_state.monitor;
  const Outcome monitored = monitor_faults(
      fault_settings.finest ? *fault_settings.finest : robot, fault_settings.monitor, weighing,
      fault_state.asked ? fault_state.q_d : motors_of(robot, q_e), q_e, monitor, believed, late);
  observe_forces(robot, fault_settings, settings.period, monitored && state.started, state.torque,
                 fault_state);
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
    std::uint32_t failed = 0, noisy = 0;
    for (int c = 0; c < n + robot.r; ++c) {
      failed |= monitor.reading[c].health == Health::failed ? bit(c) : 0;
      noisy |= monitor.reading[c].noise.noisy() ? bit(c) : 0;
    }
    const bool reweigh = failed || noisy || late;
    if (reweigh) fault_state.known = *weighing.known;
    for (int c = 0; c < n + robot.r && (failed || noisy); ++c) {
      Real& sigma = fault_state.known.sigma[c];
      // A lost motor counts as being at its setpoint: a law that weighs would estimate its error
      // from readings that hardly determine it, and drive it by that.
      if (failed & ~monitor.lost & bit(c)) sigma *= kDisbelieved;
      const ReadingNoise& noise = monitor.reading[c].noise;
      if (noisy & bit(c)) sigma = std::sqrt(sigma * sigma + noise.gain * noise.variance());
    }
    if (late) {
      low_pass(robot, *late, believed, failed & (bit(n) - 1));
      weigh(robot, *late, fault_state.known);
    }
    if (failed && !(~failed & (bit(n + robot.r) - bit(n)))) now.law = Law::joint;
    state.switched = state.switched || monitor.changed;
    const Weighing reweighed{&fault_state.known, weighing.work, weighing.kept};
    outcome = control(robot, now, setpoint, believed, state, reweigh ? reweighed : weighing);
  }
  if (outcome)
    add_payload_torque(robot, fault_settings.momentum, setpoint, fault_state.observer,
                       state.torque);
  if (outcome) fault_state.q_d = state.q_d;
  fault_state.asked = fault_state.asked || outcome;
  fault_state.unanswered = outcome ? 0 : fault_state.unanswered + settings.period;
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
    for (int i = 0; i < n; ++i) state.torque[i] = limited(robot.chain[i], fault_state.weight[i]);
    state.error = state.error_rate = state.integral = {};  // blends in after acknowledge()
  } else if (outcome) {
    fault_state.at = setpoint.x;
  } else {  // hold the last torques, without the PD of a motor lost now
    for (int i = 0; i < n; ++i)
      if (fault_state.brakes & bit(i)) state.torque[i] = limited(robot.chain[i], state.load[i]);
  }
  return outcome && monitored.status == Status::disagree ? monitored : outcome;
}

void release(FaultTolerantState& fault_state) {
  fault_state.stops = false;
  fault_state.brakes = 0;
  fault_state.stop = fault_state.unanswered = fault_state.stopping = 0;
}

void observe_forces(const Robot& robot, const FaultTolerantSettings& settings, Real period,
                    bool moves, const Joint& torque, FaultTolerantState& state) {
  const int n = robot.motors;
  FaultMonitor& monitor = state.monitor;
  MomentumObserver& observer = state.observer;
  bool observed = moves && !state.stops;
  for (int i = 0; i < n; ++i)
    observed =
        observed && monitor.reading[i].health == Health::valid && !monitor.reading[i].noise.noisy();
  if (!observed) {
    observer = {};
  } else {  // the observer takes several periods as one, and works in each of them
    const Real several = settings.momentum.period / period;
    const int every = several > 1 && several < 100 ? static_cast<int>(several + Real(0.5)) : 1;
    for (int i = 0; i < n; ++i) observer.sum[i] += torque[i];
    if (++observer.waited >= every) {
      Joint mean{};
      for (int i = 0; i < n; ++i) mean[i] = observer.sum[i] / static_cast<Real>(every);
      observer.sum = {};
      observer.waited = 0;
      sample_momentum(robot, settings.momentum, monitor.pose, mean, observer);
    }
    for (int done = 0; done < kMomentumSteps; done += every)
      static_cast<void>(observe_momentum(robot, settings.momentum, observer));
  }
  for (int i = 0; i < n; ++i)
    monitor.pushed[i] = std::fabs(observer.residual[i]) * settings.momentum.give[i];
}
}  // namespace truepose
