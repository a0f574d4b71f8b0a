// The fault-tolerant controller: fault monitor, law, stop and brakes.
//
// Laws stay what they are: what is not believed any more is replaced before they see it, and weighs
// nothing where they weigh. What cannot be replaced, or decided, stops the robot on its path.
#pragma once

#include "truepose/control/control.hpp"
#include "truepose/control/fault_monitor.hpp"

namespace truepose {

/// Time along a path: it passes as fast as real time, until the robot must stop.
struct PathClock {
  Real time = 0;     ///< s along the path
  Real rate = 1;     ///< its derivative,
  Real slowing = 0;  ///< and of that
  Real since = 0;    ///< share of the stop that has passed

  /// One period. @param stop  s in which it comes to rest, which may change on the way; 0: goes on
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

  /// What is asked of the robot where the path has `at`.
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
  Real stop = 0.15;  ///< s in which the robot comes to rest along its path,
  /// and with a lost motor: about twice the time in which a brake closes (20 ms, assumed). The
  /// brake stops that motor wherever the path is by then; the way left to the others is the error.
  Real stop_lost = 0.04;
  Real held = 0.005;  ///< s at most for which a torque is held that no reading answers for
  const Robot* finest =
      nullptr;  ///< the robot as the watch understands it; nullptr: as the law does
};

/// What it remembers, and what it says. The caller's; a new one starts anew.
struct FaultTolerantState {
  FaultMonitor watch;
  bool stops = false;        ///< the path is to be left at rest, until acknowledge():
  Real stop = 0;             ///< in so many s, for PathClock::advance(); 0: it goes on
  std::uint32_t brakes = 0;  ///< motors whose brakes must hold them, as bits, until acknowledge()
  Coordinates at{};          ///< the latest setpoint that was answered for
  Joint weight{};            ///< N·m that hold the robot there, once all brakes are asked for
  Real unanswered = 0;       ///< s since a torque was answered for
  Real stopping = 0;         ///< s since the faulty reading is undecided
  Knowledge known{};         ///< of the readings that are believed
};

/// A reading that was mended is believed again, and the robot may go on: a new PathClock leads it
/// from where it stands. What is still wrong stops it again.
inline void acknowledge(FaultTolerantState& guard, int reading) {
  acknowledge(guard.watch, reading);
  guard.stops = false;
  guard.brakes = 0;
  guard.stop = guard.unanswered = guard.stopping = 0;
}

/// σ of a reading that is not believed, over its own.
inline constexpr Real kDisbelieved = 1e4;

/// One cycle: as control(), with the readings watched.
///
/// A motor whose brake is asked for follows its feed-forward: while the brake closes it slows down
/// with the others. Once all brakes are asked for, the torques are those that hold the robot at
/// rest where it was asked to be last. No PD acts on either again before acknowledge().
///
/// @param q_e    as read
/// @param guard  in and out; `stops` and `brakes` are the caller's to obey
/// @param late   in and out: of slow and late sensors; nullptr: there are none
/// @return as control(); `disagree` and a reading: it is not valid, and the robot goes on without
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
  // Where the faulty reading is undecided, no loop is trusted longer than the stop takes.
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
      // A lost motor is taken to be where it should be: a law that weighs would find its error by
      // what says too little of it, and drive it by that.
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
    state.error = state.error_rate = state.integral = {};  // what follows acknowledge() is led in
  } else if (outcome) {
    guard.at = setpoint.x;
  } else {  // the last torques are held, but for the PD's of a motor lost in this cycle
    for (int i = 0; i < n; ++i)
      if (guard.brakes & bit(i)) state.torque[i] = limited(robot.chain[i], state.load[i]);
  }
  return outcome && watched.status == Status::disagree ? watched : outcome;
}

}  // namespace truepose
