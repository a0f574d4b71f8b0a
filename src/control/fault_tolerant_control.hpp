// The fault-tolerant controller: fault monitor, law, stop and brakes.
//
// Laws stay unchanged: they get substitutes for excluded readings and weigh these by nothing. If
// there is no substitute, or the fault is not isolated, the robot stops on its path.
#pragma once

#include "control/control.hpp"
#include "control/fault_monitor.hpp"
#include "control/momentum_observer.hpp"

namespace truepose {
/// Time along a path: runs in real time until the robot must stop.
struct PathClock {
  Real time = 0;     ///< s along the path
  Real rate = 1;     ///< d time/dt
  Real slowing = 0;  ///< d rate/dt, 1/s
  Real since = 0;    ///< elapsed share of the stop, 0 to 1

  /// Advances one period. @param stop  duration of the stop, s (may change); 0: continue
  void advance(Real period, Real stop) {
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

  /// The path's setpoint `at`, with rate and acceleration as the clock slows down.
  Setpoint paced(Setpoint at) const {
    for (std::size_t i = 0; i < at.rate.size(); ++i) {
      at.acceleration[i] = at.acceleration[i] * rate * rate + at.rate[i] * slowing;
      at.rate[i] *= rate;
    }
    return at;
  }
};

/// Constant during a run.
struct FaultTolerantSettings {
  FaultMonitorSettings monitor;
  MomentumSettings momentum;      ///< of the observer of disturbances
  const Robot* finest = nullptr;  ///< model for the fault monitor; nullptr: the law's
};

/// State and report of the controller, owned by the caller; a new one starts afresh.
struct FaultTolerantState {
  FaultMonitor monitor;
  bool stops = false;        ///< the path must stop, until acknowledge(),
  Real stop = 0;             ///< in this time, s, for PathClock::advance(); 0: continue
  std::uint32_t brakes = 0;  ///< motors whose brakes must hold, as bits, until acknowledge()
  Coordinates at{};          ///< latest setpoint with a valid cycle
  Joint weight{};       ///< torques that hold the robot there once all brakes are requested, N·m
  Real unanswered = 0;  ///< time since the last valid torque, s
  Real stopping = 0;    ///< time since the fault is undecided, s
  bool asked = false;   ///< whether there was a setpoint,
  Joint q_d{};          ///< and the last one, also of a law that starts anew
  Knowledge known{};    ///< with large σ for excluded readings
  MomentumObserver observer;
};

/// Lets the robot move: a new PathClock leads it from where it stands. What the fault monitor still
/// finds stops it again.
void release(FaultTolerantState& fault_state);

/// Marks a repaired reading as valid and releases the robot.
inline void acknowledge(FaultTolerantState& fault_state, int reading) {
  acknowledge(fault_state.monitor, reading);
  release(fault_state);
}

/// σ of an excluded reading, over its own.
inline constexpr Real kDisbelieved = 1e4;

/// Observes forces after monitor_faults(), while every motor is read and no brake acts.
/// @param torque  applied in the last control period
void observe_forces(const Robot& robot, const FaultTolerantSettings& settings, Real period,
                    bool moves, const Joint& torque, FaultTolerantState& state);

/// Runs one cycle: control() with the readings monitored.
///
/// A motor whose brake is requested follows its feed-forward: it slows down with the others while
/// the brake closes. Once all brakes are requested, the torques hold the robot at rest at its last
/// valid setpoint. No PD acts on these motors before acknowledge().
/// @param fault_state  in and out; the caller must obey `stops` and `brakes`
/// @param late   in and out: slow and delayed sensors; nullptr: none
/// @return as control(); `disagree` and a reading: it is not valid, the robot continues without it
inline Outcome control_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                                      const FaultTolerantSettings& fault_settings,
                                      const Setpoint& setpoint, const Extended& q_e,
                                      ControlState& state, const Weighing& weighing,
                                      FaultTolerantState& fault_state, Multirate* late = nullptr) {
  const int n = dof(robot.mobility);
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
}  // namespace truepose
