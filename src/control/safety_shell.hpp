// The safety shell around a law: torques and brakes that follow from the checks of each cycle.
//
// Torques pass a slew limit always. Without a fresh frame or an answer the
// model's part of the torque acts, not the loop. After a violation the loop opens: the torque holds
// the robot's weight at its last setpoint while the brakes close, then goes to zero. On the way
// back the torque holds the weight before the brakes open, and the law acts after.
//
// Bounded work, no allocation, exception or lock. No NaN reaches a motor.
#pragma once

#include "control/dynamics.hpp"
#include "control/limit_check.hpp"
#include "control/safety_states.hpp"

namespace truepose {
/// Requests of the operator. An acknowledgement and a start act when they begin.
struct SafetyRequests {
  bool start = false, stop = false, acknowledge = false;
};

/// What the shell is told in one cycle.
struct SafetyCycle : CheckedCycle {
  Joint load{};       ///< the last part of the torque from the model: feed-forward and integrals
  bool known = true;  ///< the motors are referenced, the pose is known
  std::uint32_t suspected = 0;  ///< motors that may be faulty, as bits
  bool lost = false;            ///< a motor has no substitute, or cannot be excluded
  bool disagree = false;        ///< readings disagree, none is isolated
  SafetyRequests request;
};

/// Report of a shell.
struct SafetyReport {
  SafetyState state = SafetyState::stopped;    ///< of the machine
  StopCause cause = StopCause::none;           ///< the first since the acknowledgement,
  int part = -1;                               ///< and its motor or -1
  StopCause refused = StopCause::none;         ///< why a request of this cycle has no effect
  std::uint32_t causes = 0;                    ///< all since the acknowledgement, as bits
  std::uint32_t brakes = bit(kMaxMotors) - 1;  ///< motors whose brakes must hold, as bits
  int follows = false;  ///< 1: the law acts; else it starts anew in each cycle, and no path moves
  int unused = 0;
  Real path_stop = 0;  ///< duration of the stop along the path, s, for PathClock; 0: continue
  Joint torque{};      ///< to the motors
};

/// State and report, the caller's; a new one is switched on: stopped, with closed brakes.
struct SafetyShell : SafetyReport, LimitState {
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
