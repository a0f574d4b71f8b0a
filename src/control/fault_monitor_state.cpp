// Settings and state of the fault monitor.
#include "control/fault_monitor_state.hpp"

namespace truepose {
void prepare(FaultMonitorSettings& settings) {
  const Real each = settings.false_alarm / 2;
  for (int k = 1; k <= kMaxSensors; ++k) settings.chi2[k] = chi2_beyond(each, k);
  settings.sigmas = std::sqrt(settings.chi2[1]);
  settings.own = tracker_gains(kOwnPole);
  settings.together = tracker_gains(kParityPole);
  settings.refresh = std::max(1, settings.refresh);
}

void acknowledge(FaultMonitor& monitor, int reading) {
  if (reading < 0 || reading >= kMaxReadings) return;
  MonitoredReading anew;
  anew.own = monitor.reading[reading].own;  // its value until there is a number
  monitor.reading[reading] = anew;
  monitor.doubted = monitor.lost = 0;
  monitor.undecided = false;
  monitor.disagreed = 0;
  monitor.began = monitor.cycle;
}

}  // namespace truepose

namespace truepose::fault_monitor_detail {
void bridge(const FaultMonitorSettings& settings, std::int64_t cycle, Symptom symptom, int every,
            MonitoredReading& reading) {
  const auto spike = [&](std::int64_t k) -> std::int64_t& {
    return reading.spike[static_cast<std::size_t>(k % kSpikesKept)];
  };
  reading.symptom = symptom;
  reading.health = Health::suspect;
  const bool stands = symptom == Symptom::stuck;
  if (reading.bridged++ == 0 && !stands) spike(reading.spikes++) = cycle;
  const int k = settings.spikes;
  const bool often = reading.spikes >= k && cycle - spike(reading.spikes - k) < settings.within;
  // A standstill counts from the last change on, however late it was noticed.
  const int times = stands ? reading.still : reading.bridged;
  if (times > settings.coast * (stands ? 2 : every) || (often && !stands))
    reading.health = Health::failed;
}
}  // namespace truepose::fault_monitor_detail
