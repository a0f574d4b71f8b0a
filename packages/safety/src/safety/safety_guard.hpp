// The safety shell as the guard of the core's control cycle.
#pragma once

#include "control/guarded_control.hpp"
#include "safety/safety_shell.hpp"

namespace truepose {
/// Fills in a cycle after the law: setpoint, readings, answer, and what the fault monitor has found
/// about the motors. A candidate for a fault is plausible, within the limits, unless its reading
/// stands still beside an error that drives it.
void complete(int n, const Setpoint& setpoint, const Extended& q_e, Outcome answer,
              const ControlState& state, const FaultMonitor* monitor, SafetyCycle& cycle);

/// Its functions are inline: the library, compiled without type information, has none of its own of
/// this class.
struct SafetyGuard final : Guard {
  SafetyLimits limits;
  SafetyShell shell;
  SafetyCycle next;                     ///< the caller's: marks of the next frame, known, requests
  bool counted = false;                 ///< the frame's mark is `frame`
  StopCause refused = StopCause::none;  ///< first of a simulated start

  void guard(const Robot& robot, const Setpoint& setpoint, const Extended& q_e, Outcome answer,
             const ControlState& state, const FaultMonitor* monitor) TRUEPOSE_BOUNDED override {
    if (counted) next.counter = {true, frame};
    complete(robot.motors, setpoint, q_e, answer, state, monitor, next);
    truepose::guard(robot, limits, next, shell);
  }
  const GuardReport& report() const TRUEPOSE_BOUNDED override { return shell; }
  bool begins(int cycle) override;
  void restart() override {
    shell = {};
    frame = 0;
  }
};

inline bool SafetyGuard::begins(int cycle) {
  constexpr int kWaits = 48;  // cycles
  if (cycle == 0) refused = StopCause::none;
  if (cycle > 0 && refused == StopCause::none) refused = shell.refused;
  const bool waits = !shell.follows && cycle < 1000 + limits.brake / limits.period;
  next.request = {waits && cycle > kWaits, false, waits && cycle >= kWaits};
  if (!waits && shell.cause == StopCause::none) shell.cause = refused;
  return waits;
}
}  // namespace truepose
