// Substitutes for excluded readings, and the geometry's part of the parity.
#include "control/monitored_cycle.hpp"

namespace truepose::fault_monitor_detail {
void MonitoredCycle::exclude(int c) {
  const Reading g = parity.signature(r, c);
  Real size = 0, known = 0;
  for (int k : range(r)) {
    size += g[k] * g[k];
    known += noise[n + k] + monitor.geometry[k][k];
    for (int j : range(n)) known += parity.g[k][j] * parity.g[k][j] * noise[j];
  }
  if (!(size > 0 && known > 0)) return;
  unknown[c] = kUnknown * known / size;
  ++left_out;
}

bool MonitoredCycle::replaceable(int c, Real left, const ReadingCovariance& V,
                                 const ReadingCovariance& own) const {
  if (!(left < settings.replaceable * settings.replaceable)) return false;
  const Real most = settings.shaken[c];
  if (!(most > 0)) return true;
  Reading g = parity.signature(r, c);
  V.whiten(r, g.data(), 1);
  V.colour(r, g.data());
  Real sum = 0;
  for (int k : range(r))
    for (int l : range(r)) sum += g[k] * own.L[max(k, l)][min(k, l)] * g[l];
  return unknown[c] * unknown[c] * sum < most * most;
}

Real MonitoredCycle::extrapolated_error(int c) {
  FollowingError& error = monitor.reading[c].following;
  if (!monitor.reading[c].standstill.stuck) return error.now;
  const Real T = settings.period;
  error.led_out.rate =
      (error.led_out.rate - T * settings.kp[c] * error.led_out.value) / (1 + T * settings.kd[c]);
  return error.led_out.value = error.led_out.predicted(T);
}

void MonitoredCycle::substitute() {
  ReadingCovariance V, own;
  const bool regular = r > 0 && covariance(1, 1, V);
  Reading y = parity.value;
  if (regular) {
    parity.covariance(r, noise, monitor.geometry, 0, own);
    V.whiten(r, y.data(), 1);
  }
  Coordinates step{};
  for (int c : range(rows)) {
    if (!(without & bit(c))) continue;
    const MonitoredReading& reading = monitor.reading[c];
    const bool failed = reading.health == Health::failed, motor = c < n;
    const Column error = regular ? column_of(c, V, y) : Column{};
    const Real b = unknown[c] * error.score;
    const Real left = unknown[c] * (1 - unknown[c] * error.information);  // variance of b̂
    const bool known = regular && unknown[c] > 0 && left < 0.5 * unknown[c] && number(b);
    // A lost motor stays lost: its brake is closing.
    if (known && !(monitor.lost & bit(c)) && (failed || (motor && reading.standstill.stuck)) &&
        (!motor || replaceable(c, left, V, own))) {
      replaced |= bit(c);
      believed[c] -= b;
      for (int i = 0; motor && i < dof(robot.mobility); ++i)
        step[i] -= parity.jacobians.J[i][c] * b;
      continue;
    }
    believed[c] = reading.track.predicted(settings.period);
    if (motor) {
      if (failed) monitor.lost |= bit(c);
      if (number(desired[c])) believed[c] = desired[c] - (failed ? 0 : extrapolated_error(c));
    } else if (failed) {
      believed[c] = model(c);                              // as far as the motors determine it
    } else if (delayed(c) || !(without & (bit(n) - 1))) {  // follows the motors
      believed[c] =
          parity.read[c] - parity.value[c - n] + monitor.parity[c - n].predicted(settings.period);
    }
  }
  parity.pose = moved(robot.mobility, parity.pose, step);
}

void MonitoredCycle::refresh() {
  for (int i : range(dof(robot.mobility))) monitor.way += fabs(monitor.motion[i]);
  // Not in the first cycle, which searches the pose.
  const bool due = (monitor.cycle + settings.refresh - 1) % settings.refresh == 0;
  if (!due && !(monitor.way > kSamePlace * settings.correlation)) return;
  monitor.way = 0;
  Extended beyond;
  // An earlier covariance remains valid where this one fails.
  if (!parity.geometry_at(robot, monitor.pose, *weighing.known, weighing.work, monitor.geometry,
                          beyond, monitor.rest))
    return;
  monitor.known = true;
  for (int k : range(r)) {
    Real more = beyond[n + k] - monitor.beyond[n + k];
    for (int j : range(n)) more -= parity.g[k][j] * (beyond[j] - monitor.beyond[j]);
    if (!number(more)) continue;  // the parity's tracker must not see a change,
    monitor.parity[k].value -= more;
    monitor.usual[k] -= more;
    monitor.reading[n + k].standstill.model += more;  // nor a sensor that stands still a motion
    monitor.reading[n + k].standstill.driven.from += more;
  }
  monitor.beyond = beyond;
}
}  // namespace truepose::fault_monitor_detail
