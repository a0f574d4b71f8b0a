// The steps of the fault monitor's cycle.
#include "control/fault_monitor.hpp"

#include "control/monitored_cycle.hpp"

namespace truepose {
namespace fault_monitor_detail {
Real MonitoredCycle::model(int c) const {
  if (delayed(c)) return late->then[c - n];
  // At the motors' pose; `expected` is at the pose from which that was found.
  return c < n ? desired[c] : parity.read[c] - parity.value[c - n];
}

Outcome MonitoredCycle::run() {
  for (int c : range(rows)) noise[c] = weighing.known->sigma[c] * weighing.known->sigma[c];
  // Starts at the first readings that have a pose: earlier, a motor has no substitute.
  const bool first_cycle = monitor.cycle == 0;
  for (int c = 0; first_cycle && c < n; ++c)
    if (!number(q_e[c])) {
      monitor.reading[c].health = Health::suspect;
      monitor.reading[c].symptom = Symptom::missing;
      return {Status::not_finite, c};
    }
  test_readings(0, n);
  if (late) extrapolate_delayed();
  test_readings(n, rows);
  const Outcome placed = parity.locate(robot, monitor, believed, monitor.beyond);
  if (!placed && first_cycle) return placed;
  if (!placed && monitor.cycle == monitor.began) ++monitor.began;
  if (placed) {
    for (int c : range(rows))
      if (without & bit(c)) exclude(c);
    if (r > 0 && monitor.cycle - monitor.began > kSettling) test_parity();
    if (without) substitute();
    monitor.last = monitor.motion;
    monitor.motion =
        monitor.placed ? difference(robot.mobility, parity.pose, monitor.pose) : Coordinates{};
    monitor.pose = parity.pose;
  }
  monitor.placed = bool(placed);
  const int first = update();
  if (placed && r > 0) {
    update_parity();
    refresh();
  }
  ++monitor.cycle;
  if (!placed) return placed;
  return {first < 0 ? Status::ok : Status::disagree, first};
}

int MonitoredCycle::update() {
  int first = -1;
  std::uint32_t gone = 0;
  const bool motors = monitor.placed && !monitor.failed(n);  // whether they give the pose
  for (int c : range(rows)) {
    MonitoredReading& reading = monitor.reading[c];
    // With a lost motor the robot does not follow its setpoint. While it stops on an undecided
    // fault it does: the faulty motor may still be isolated.
    const bool decided = !monitor.doubted || (monitor.undecided && c < n);
    update_standstill(c, decided && !(symptomatic & ~standing) && !monitor.lost &&
                             settings.moved[c] > 0 && (c < n || motors) &&
                             reading.health != Health::failed);
    const bool excluded = without & bit(c);
    Real news = innovation[c];
    if (excluded) {  // the track follows the substitute
      news = believed[c] - reading.track.predicted(settings.period);
      gone |= reading.health == Health::failed || replaced & bit(c) ? bit(c) : 0;
    } else {
      if (reading.health == Health::suspect) reading.health = Health::valid;
      reading.extrapolated.cycles = 0;
      reading.scatter += (news * news - reading.scatter) / kSettling;
      FollowingError& error = reading.following;
      const Real now = c < n ? desired[c] - believed[c] : NAN, off = now - error.usual;
      if (number(now)) error.now = now;
      if (number(off) && reading.standstill.cycles == 0) {
        error.deviation = off;
        error.usual += off / kSettling;
        error.variance += (off * off - error.variance) / kSettling;
      }
    }
    reading.track.correct(settings.period, kOwnPole, number(news) ? news : 0);
    if (monitor.doubted & bit(c) && reading.health == Health::valid)
      reading.health = Health::suspect;
    if (first < 0 && reading.health != Health::valid) first = c;
  }
  monitor.desired = desired;
  monitor.changed = monitor.without != gone || (monitor.held & ~held) != 0;
  monitor.without = gone;
  monitor.held = held;
  return first;
}

void MonitoredCycle::update_parity() {
  const bool holds = monitor.doubted || symptomatic;  // no correction by a possible fault
  for (int k : range(r)) {
    Tracker& tracker = monitor.parity[k];
    const Real value = parity.value[k], change = value - tracker.predicted(settings.period);
    if (monitor.cycle == monitor.began) tracker = {monitor.usual[k] = value, 0};
    if (!holds && number(value)) monitor.usual[k] += (value - monitor.usual[k]) / kSettling;
    tracker.correct(settings.period, kParityPole, holds || !number(change) ? 0 : change);
    if (holds) tracker.rate *= kParityPole;
  }
}
}  // namespace fault_monitor_detail

Outcome monitor_faults(const Robot& robot, const FaultMonitorSettings& settings,
                       const Weighing& weighing, const Joint& desired, const Extended& q_e,
                       FaultMonitor& monitor, Extended& believed, Multirate* late) {
  if (!robot.finished) return {Status::unfinished};
  if (!weighing) return {Status::not_measured};
  return fault_monitor_detail::MonitoredCycle(
             {robot, settings, weighing, desired, q_e, monitor, believed, late})
      .run();
}
}  // namespace truepose
