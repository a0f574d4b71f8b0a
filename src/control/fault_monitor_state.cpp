// Settings and state of the fault monitor.
#include "control/fault_monitor_state.hpp"

namespace truepose {
void prepare(FaultMonitorSettings& settings) {
  const Real each = settings.false_alarm / 2;
  for (int k : range(1, kMaxSensors + 1)) settings.chi2[k] = chi2_beyond(each, k);
  settings.sigmas = sqrt(settings.chi2[1]);
  settings.decisive = 0.5 * settings.chi2[1];
  settings.own = tracker_gains(kOwnPole);
  settings.together = tracker_gains(kParityPole);
  settings.refresh = max(1, settings.refresh);
}

void acknowledge(FaultMonitor& monitor, int reading) {
  if (reading < 0 || reading >= kMaxReadings) return;
  MonitoredReading anew;
  anew.track = monitor.reading[reading].track;  // its value until there is a number
  monitor.reading[reading] = anew;
  monitor.doubted = monitor.lost = 0;
  monitor.undecided = false;
  monitor.disagreement = {};
  monitor.began = monitor.cycle;
}
}  // namespace truepose
