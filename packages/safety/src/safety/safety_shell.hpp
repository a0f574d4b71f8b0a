// The safety shell around a law: torques and brakes that follow from the checks of each cycle.
//
// Torques pass a slew limit always. Without a fresh frame or an answer the
// model's part of the torque acts, not the loop. After a violation the loop opens: the torque holds
// the robot's weight at its last setpoint while the brakes close, then goes to zero. On the way
// back the torque holds the weight before the brakes open, and the law acts after.
//
// Bounded work, no allocation, exception or lock. No NaN reaches a motor.
#pragma once

#include "control/limit_check.hpp"
#include "control/supervisor.hpp"
#include "safety/safety_states.hpp"

namespace truepose {
/// Requests of the operator. An acknowledgement and a start act when they begin.
struct SafetyRequests {
  bool start = false, stop = false, acknowledge = false;
};

/// What the shell is told in one cycle.
struct SafetyCycle : CheckedCycle {
  Joint load{};        ///< the last part of the torque from the model: feed-forward and integrals
  bool known = true;   ///< the motors are referenced,
  bool placed = true;  ///< and the fault monitor has their pose
  std::uint32_t suspected = 0;  ///< motors that may be faulty, as bits
  bool lost = false;            ///< a motor has no substitute, or cannot be excluded
  bool disagree = false;        ///< readings disagree, none is isolated
  SafetyRequests request;
};

/// State and report, the caller's; a new one is switched on: stopped, with closed brakes.
struct SafetyShell : GuardReport, LimitState {
  SafetyMachine machine;
  bool started = false, acknowledged = false;  ///< requests of the last cycle
  Real since = 0;                              ///< time in this state, s
  Real opening = 0;                            ///< time since the brakes were released, s
  Real halted = 0;   ///< time for which the setpoint of a stop along the path stands still, s
  Coordinates at{};  ///< the last setpoint that the law followed,
  Joint weight{};    ///< and the torques that hold the robot there
};

/// One cycle, after the law's: `shell.torque` goes to the motors, `shell.brakes` to the brakes.
/// Usually it costs about 200 instructions per motor; where a stop or a run begins, inverse
/// dynamics at one pose in addition.
void guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
           SafetyShell& shell);
}  // namespace truepose
