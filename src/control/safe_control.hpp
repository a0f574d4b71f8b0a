// One cycle of any law inside the safety shell, with or without the fault monitor.
#pragma once

#include "control/fault_tolerant_control.hpp"
#include "control/safety_shell.hpp"

namespace truepose {
/// The fault monitor around the law, settings and state or none, and slow and delayed sensors.
struct Monitored {
  const FaultTolerantSettings* settings = nullptr;
  FaultTolerantState* state = nullptr;
  Multirate* late = nullptr;  ///< slow and delayed sensors; nullptr: none
};

/// Fills in what the fault monitor has found about the motors. A candidate for a fault is
/// plausible, within the shell's limits, unless its reading stands still beside an error that
/// drives it.
void note_monitor(int n, const FaultMonitor& monitor, SafetyCycle& cycle);

/// Runs one cycle: control() or control_fault_tolerant(), then guard(). The torques and brakes are
/// shell.torque and shell.brakes; the path moves only while shell.follows, and slows down where
/// shell.path_stop > 0.
/// @param cycle  counter, timestamp, requests, and whether the pose is known, fresh in each cycle;
/// the rest is filled in
/// @return of the law
inline Outcome control_safely(const Robot& robot, const ControlSettings& settings,
                              const SafetyLimits& limits, const Setpoint& setpoint,
                              const Extended& q_e, ControlState& state, SafetyShell& shell,
                              SafetyCycle& cycle, const Weighing& weighing = {},
                              const Monitored& monitored = {}) {
  const int n = robot.motors;
  if (!shell.follows) {  // a stopped robot starts anew; what stops it is the shell's to latch
    state = {};
    if (monitored.state) release(*monitored.state);
  }
  Outcome outcome;
  if (monitored.state) {
    outcome = control_fault_tolerant(robot, settings, *monitored.settings, setpoint, q_e, state,
                                     weighing, *monitored.state, monitored.late);
    note_monitor(n, monitored.state->monitor, cycle);
  } else {
    Knowledge known;
    Extended now = q_e;
    const Weighing by =
        monitored.late ? compensated(robot, weighing, *monitored.late, known, now) : weighing;
    outcome = control(robot, settings, setpoint, now, state, by);
  }
  cycle.x = setpoint.x;
  cycle.q_d = state.q_d;
  std::copy_n(q_e.begin(), n, cycle.q.begin());
  cycle.answer = outcome;
  cycle.torque = state.torque;
  cycle.load = state.load;
  cycle.error = state.error;
  guard(robot, limits, cycle, shell);
  return outcome;
}
}  // namespace truepose
