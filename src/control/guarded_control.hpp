// One cycle of any law with a package's guard behind it, with or without the fault monitor.
#pragma once

#include "control/fault_tolerant_control.hpp"

namespace truepose {
/// The fault monitor around the law, settings and state or none, and slow and delayed sensors.
struct Monitored {
  const FaultTolerantSettings* settings = nullptr;
  FaultTolerantState* state = nullptr;
  Multirate* late = nullptr;  ///< slow and delayed sensors; nullptr: none
};

/// Runs one cycle: control() or control_fault_tolerant(), then the guard. The machine gets torques
/// and brakes of the guard's report; the path moves only while the law acts, and slows down where
/// `path_stop` > 0.
/// @return of the law
inline Outcome control_guarded(const Robot& robot, const ControlSettings& settings,
                               const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                               Guard& guard, const Weighing& weighing = {},
                               const Monitored& monitored = {}) {
  FaultTolerantState* const monitor = monitored.state;
  if (!guard.report().follows) {  // a stopped robot starts anew; what stops it is the guard's
    state = {};
    if (monitor) release(*monitor);
  }
  Outcome outcome;
  if (monitor) {
    outcome = control_fault_tolerant(robot, settings, *monitored.settings, setpoint, q_e, state,
                                     weighing, *monitor, monitored.late);
  } else {
    Knowledge known;
    Extended now = q_e;
    const Weighing by =
        monitored.late ? compensated(robot, weighing, *monitored.late, known, now) : weighing;
    outcome = control(robot, settings, setpoint, now, state, by);
  }
  guard.guard(robot, setpoint, q_e, outcome, state, monitor ? &monitor->monitor : nullptr);
  return outcome;
}
}  // namespace truepose
