// The fault-tolerant controller: fault monitor, law, stop and brakes.
//
// Laws stay unchanged: they get substitutes for excluded readings and weigh these by nothing. If
// there is no substitute, or the fault is not isolated, the robot stops on its path.
#pragma once

#include "truepose/control/control.hpp"
#include "truepose/control/fault_monitor.hpp"

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
  FaultMonitorSettings watch;
  Real stop = 0.15;  ///< duration of a stop along the path, s
  /// Duration with a lost motor, s: about twice the closing time of a brake (20 ms, assumed). The
  /// brake stops that motor wherever the path is by then; the error is the others' way left.
  Real stop_lost = 0.04;
  Real held = 0.005;              ///< longest time for which the last valid torque is held, s
  const Robot* finest = nullptr;  ///< model for the fault monitor; nullptr: the law's
};

/// State and report of the controller, owned by the caller; a new one starts afresh.
struct FaultTolerantState {
  FaultMonitor watch;
  bool stops = false;        ///< the path must stop, until acknowledge(),
  Real stop = 0;             ///< in this time, s, for PathClock::advance(); 0: continue
  std::uint32_t brakes = 0;  ///< motors whose brakes must hold, as bits, until acknowledge()
  Coordinates at{};          ///< latest setpoint with a valid cycle
  Joint weight{};       ///< torques that hold the robot there once all brakes are requested, N·m
  Real unanswered = 0;  ///< time since the last valid torque, s
  Real stopping = 0;    ///< time since the fault is undecided, s
  Knowledge known{};    ///< with large σ for excluded readings
};

/// Marks a repaired reading as valid and lets the robot move: a new PathClock leads it from where
/// it stands. A remaining fault stops it again.
inline void acknowledge(FaultTolerantState& guard, int reading) {
  acknowledge(guard.watch, reading);
  guard.stops = false;
  guard.brakes = 0;
  guard.stop = guard.unanswered = guard.stopping = 0;
}

/// σ of an excluded reading, over its own.
inline constexpr Real kDisbelieved = 1e4;

/// Runs one cycle: control() with the readings monitored.
///
/// A motor whose brake is requested follows its feed-forward: it slows down with the others while
/// the brake closes. Once all brakes are requested, the torques hold the robot at rest at its last
/// valid setpoint. No PD acts on these motors before acknowledge().
/// @param guard  in and out; the caller must obey `stops` and `brakes`
/// @param late   in and out: slow and delayed sensors; nullptr: none
/// @return as control(); `disagree` and a reading: it is not valid, the robot continues without it
template <Mobility K>
Outcome control_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                               const FaultTolerantSettings& guarding, const Setpoint& setpoint,
                               const Extended& q_e, ControlState& state, const Weighing& weighing,
                               FaultTolerantState& guard, Multirate* late = nullptr) {
  constexpr int n = kDof<K>;
  Extended believed = q_e;
  const Outcome watched = monitor_faults<K>(
      guarding.finest ? *guarding.finest : robot, guarding.watch, weighing,
      state.started ? state.q_d : motors_of<K>(q_e), q_e, guard.watch, believed, late);
  constexpr std::uint32_t all = bit(n) - 1;
  const bool held = guard.brakes == all;
  guard.stops = guard.stops || guard.watch.undecided || guard.watch.lost != 0;
  guard.brakes |= guard.watch.lost;
  // While the fault is undecided, no loop stays closed longer than the stop takes.
  if (guard.watch.undecided) guard.stopping += settings.period;
  if (guard.stopping > guarding.stop) guard.brakes = all;
  state.switched = state.switched || state.braked != guard.brakes;
  state.braked = guard.brakes;
  Outcome outcome = watched;
  if (watched) {
    ControlSettings now = settings;
    guard.known = *weighing.known;
    bool any = false, left = false, motor = false;
    for (int c = 0; c < n + robot.r; ++c) {
      const bool failed = guard.watch.reading[c].health == Health::failed;
      // A lost motor counts as being at its setpoint: a law that weighs would estimate its error
      // from readings that hardly determine it, and drive it by that.
      if (failed && !(guard.watch.lost >> c & 1U)) guard.known.sigma[c] *= kDisbelieved;
      any = any || failed;
      motor = motor || (c < n && failed);
      left = left || (c >= n && !failed);
    }
    if (late) {
      low_pass(robot, *late, believed, motor);
      weigh(robot, *late, guard.known);
    }
    if (any && !left) now.law = Law::joint;
    state.switched = state.switched || guard.watch.changed;
    const Weighing reweighed{&guard.known, weighing.work, weighing.kept};
    outcome = control<K>(robot, now, setpoint, believed, state, any || late ? reweighed : weighing);
  }
  guard.unanswered = outcome ? 0 : guard.unanswered + settings.period;
  if (guard.unanswered > guarding.held) {
    guard.stops = true;
    guard.brakes = all;
  }
  if (guard.stops) guard.stop = guard.watch.lost ? guarding.stop_lost : guarding.stop;
  if (guard.brakes == all) {
    if (!held &&
        (!state.started || !inverse_dynamics<K>(robot, to_pose<K>(guard.at), {}, {}, guard.weight)))
      guard.weight = {};
    for (int i = 0; i < n; ++i) state.torque[i] = limited(robot.chain[i], guard.weight[i]);
    state.error = state.error_rate = state.integral = {};  // blends in after acknowledge()
  } else if (outcome) {
    guard.at = setpoint.x;
  } else {  // hold the last torques, without the PD of a motor lost now
    for (int i = 0; i < n; ++i)
      if (guard.brakes & bit(i)) state.torque[i] = limited(robot.chain[i], state.load[i]);
  }
  return outcome && watched.status == Status::disagree ? watched : outcome;
}
}  // namespace truepose
