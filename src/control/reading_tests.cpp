// Tests of a single reading: a number, within its range, no faster than the motors can make it.
#include "control/monitored_cycle.hpp"

namespace truepose::fault_monitor_detail {
void MonitoredCycle::test_readings(int begin, int end) {
  for (int c : range(begin, end)) {
    MonitoredReading& reading = monitor.reading[c];
    if (!reading.begun && number(q_e[c])) {
      reading.begun = true;
      reading.track = {q_e[c], 0};
      const Real off = c < n ? desired[c] - q_e[c] : 0;
      reading.following.usual = number(off) ? off : 0;
    }
    const Real predicted = reading.track.predicted(settings.period), news = q_e[c] - predicted;
    innovation[c] = within_turn(robot, c, news);
    // Whole turns that an encoder has lost or passed since the start are no motion.
    believed[c] = innovation[c] == news ? q_e[c] : predicted + innovation[c];
    const bool failed = reading.health == Health::failed;
    const Symptom symptom = failed ? reading.symptom : symptom_of(c);
    if (symptom == Symptom::none && !failed) continue;
    believed[c] = predicted;
    without |= bit(c);
    if (failed) continue;
    if (symptom == Symptom::stuck) standing |= bit(c);
    extrapolate(c, symptom);
    if (!reading.begun) reading.health = Health::failed;  // nothing to extrapolate from
  }
}

Symptom MonitoredCycle::symptom_of(int c) const {
  const MonitoredReading& reading = monitor.reading[c];
  if (!number(q_e[c])) return Symptom::missing;
  if (settings.low[c] < settings.high[c] &&
      !(q_e[c] >= settings.low[c] && q_e[c] <= settings.high[c]))
    return Symptom::out_of_range;
  if (reading.standstill.stuck && raw(c) == reading.standstill.reading) return Symptom::stuck;
  const bool followed = monitor.cycle - monitor.began > kFollowed && settings.fastest[c] > 0;
  if (monitor.undecided || !followed) return Symptom::none;
  // With pole p the track, extrapolated over m missing cycles, lags by another m(1 + p)/(1 - p)
  // + m(m + 1)/2 of an acceleration. A reading that jumped must return to its prediction.
  const bool gap = reading.symptom == Symptom::missing || reading.symptom == Symptom::stuck;
  const int m = gap ? reading.extrapolated.cycles : 0;
  const Real lag = m * ((1 + kOwnPole) / (1 - kOwnPole) + 0.5 * (m + 1));
  const Real way =
      settings.period * settings.period * settings.fastest[c] * (settings.own.acceleration + lag);
  const Real chance = settings.sigmas * sqrt(settings.own.variance * noise[c]) * (1 + m);
  return fabs(innovation[c]) > way + chance ? Symptom::too_fast : Symptom::none;
}

Real MonitoredCycle::track_variance(int c) const {
  return settings.own.variance * noise[c] + monitor.reading[c].scatter;
}

void MonitoredCycle::extrapolate(int c, Symptom symptom) {
  MonitoredReading& reading = monitor.reading[c];
  Extrapolations& times = reading.extrapolated;
  const auto begun = [&](std::int64_t k) -> std::int64_t& {
    return times.begun[std::size_t(k % kSpikesKept)];
  };
  symptomatic |= bit(c);
  without |= bit(c);
  reading.symptom = symptom;
  reading.health = Health::suspect;
  const bool stuck = symptom == Symptom::stuck;
  if (times.cycles++ == 0 && !stuck) begun(times.count++) = monitor.cycle;
  const int k = settings.spikes;
  const bool often =
      !stuck && times.count >= k && monitor.cycle - begun(times.count - k) < settings.within;
  // A standstill counts from the last change on, however late it was noticed.
  const int cycles = stuck ? reading.standstill.cycles : times.cycles;
  if (often || cycles > settings.coast * (stuck ? 2 : every(c))) reading.health = Health::failed;
}

void MonitoredCycle::extrapolate_delayed() {
  Extended by = q_e;
  copy_first(n, believed, by);
  if (!compensate_latency(robot, *late, by)) return;
  std::copy_n(by.begin() + n, r, q_e.begin() + n);
  const bool motors = !monitor.failed(n);  // a delayed reading cannot substitute a motor
  for (int c : range(rows)) {
    if (delayed(c))
      noise[c] = motors ? noise[c] + latency_variance(*late, c - n, late->before[c - n]) : 1;
    else if (c < n && innovation[c] * innovation[c] > settings.chi2[1] * track_variance(c))
      monitor.reading[c].left_track = monitor.cycle;
  }
}
}  // namespace truepose::fault_monitor_detail
