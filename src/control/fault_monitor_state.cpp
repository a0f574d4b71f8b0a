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
  for (std::size_t c = 0; c < settings.wild.size(); ++c)
    settings.wild[c] =
        kWild * std::sqrt(settings.own.variance) *
        noisiest(settings.period, kUnmodelled * settings.fastest[c], settings.replaceable);
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
  monitor.warm_up = {};
}

}  // namespace truepose

namespace truepose::fault_monitor_detail {
void bridge(const FaultMonitorSettings& settings, std::int64_t cycle, Symptom symptom, int every,
            bool wild, MonitoredReading& reading) {
  const auto spike = [&](std::int64_t k) -> std::int64_t& {
    return reading.spike[static_cast<std::size_t>(k % kSpikesKept)];
  };
  reading.symptom = symptom;
  reading.health = Health::suspect;
  const bool stands = symptom == Symptom::stuck;
  const bool jumps = symptom == Symptom::too_fast || symptom == Symptom::disagrees;
  const bool again = jumps && reading.spikes > 0 && cycle - spike(reading.spikes - 1) < kThirds;
  const bool noise = jumps && !wild && reading.noise.may_be_noisy();
  if (reading.bridged++ == 0 && !stands && !again && !noise) spike(reading.spikes++) = cycle;
  const int k = settings.spikes;
  const bool often = reading.spikes >= k && cycle - spike(reading.spikes - k) < settings.within;
  // A standstill counts from the last change on, however late it was noticed.
  const std::int64_t coast = settings.coast, interval = static_cast<int>(reading.noise.interval);
  const std::int64_t slow = 2 * std::max(coast, interval);
  const int times = stands ? reading.still : reading.bridged;
  const std::int64_t most = stands ? slow : noise ? 2 * coast : coast * every;
  if (times > most || (often && !stands && !noise)) reading.health = Health::failed;
}
}  // namespace truepose::fault_monitor_detail
