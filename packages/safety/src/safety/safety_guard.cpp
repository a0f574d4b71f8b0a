// The safety shell as the guard of the core's control cycle.
#include "safety/safety_guard.hpp"

namespace truepose {
void complete(int n, const Setpoint& setpoint, const Extended& q_e, Outcome answer,
              const ControlState& state, const FaultMonitor* monitor, SafetyCycle& cycle) {
  cycle.unused = cycle.suspected = 0;
  cycle.lost = cycle.disagree = false;
  cycle.placed = !monitor || monitor->placed;
  if (monitor) {
    std::uint32_t stuck = 0;
    for (int i = 0; i < n; ++i) {
      const MonitoredReading& motor = monitor->reading[i];
      if (monitor->doubted & bit(i) && motor.standstill.may_be_frozen()) stuck |= bit(i);
    }
    cycle.unused = monitor->unused(n);
    cycle.suspected = cycle.unused | stuck | (monitor->lost & (bit(n) - 1));
    cycle.lost = monitor->lost || (monitor->undecided && stuck);
    cycle.disagree = monitor->undecided && !cycle.lost;
  }
  cycle.x = setpoint.x;
  cycle.q_d = state.q_d;
  std::copy_n(q_e.begin(), n, cycle.q.begin());
  cycle.answer = answer;
  cycle.torque = state.torque;
  cycle.load = state.load;
  cycle.error = state.error;
}
}  // namespace truepose
