// One cycle of any law inside the safety shell, with or without the fault monitor.
#include "control/safe_control.hpp"

namespace truepose {
void note_monitor(int n, const FaultMonitor& monitor, SafetyCycle& cycle) {
  std::uint32_t stuck = 0;
  for (int i = 0; i < n; ++i) {
    const MonitoredReading& motor = monitor.reading[i];
    if (motor.health == Health::failed || motor.bridged > 0) cycle.unused |= bit(i);
    if (monitor.doubted & bit(i) && motor.still >= kStill && motor.seems != 0) stuck |= bit(i);
  }
  cycle.unused |= monitor.held;
  cycle.suspected |= cycle.unused | stuck | (monitor.lost & (bit(n) - 1));
  cycle.known = cycle.known && monitor.placed;
  cycle.lost = monitor.lost || (monitor.undecided && stuck);
  cycle.disagree = monitor.undecided && !cycle.lost;
}
}  // namespace truepose
