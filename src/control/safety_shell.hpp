// The safety shell around a law: checks of each cycle, and torques and brakes that follow from
// them.
//
// It trusts no reading. Torques pass a slew limit always. Without a fresh frame or an answer the
// model's part of the torque acts, not the loop. After a violation the loop opens: the torque holds
// the robot's weight at its last setpoint while the brakes close, then goes to zero. On the way
// back the torque holds the weight before the brakes open, and the law acts after.
//
// Bounded work, no allocation, exception or lock. No NaN reaches a motor.
#pragma once

#include <bit>

#include "control/dynamics.hpp"
#include "control/frame_clock.hpp"
#include "control/parity.hpp"
#include "control/safety_limits.hpp"
#include "control/safety_states.hpp"

namespace truepose {
/// Requests of the operator. An acknowledgement and a start act when they begin.
struct SafetyRequests {
  bool start = false, stop = false, acknowledge = false;
};

/// What the shell is told in one cycle.
struct SafetyCycle {
  Coordinates x{};    ///< pose of the setpoint
  Joint q_d{};        ///< desired motor readings
  Joint q{};          ///< motor readings
  Outcome answer;     ///< of the law
  Joint torque{};     ///< its torque,
  Joint load{};       ///< and the last part of that from the model: feed-forward and integrals
  Joint error{};      ///< ê_q
  FrameMark counter;  ///< of the readings' frame,
  FrameMark time;     ///< and its timestamp, ns
  bool known = true;  ///< the motors are referenced, the pose is known
  std::uint32_t unused = 0;     ///< motors whose readings the law does not use, as bits
  std::uint32_t suspected = 0;  ///< motors that may be faulty, as bits
  bool lost = false;            ///< a motor has no substitute, or cannot be excluded
  bool disagree = false;        ///< readings disagree, none is isolated
  SafetyRequests request;
};

inline constexpr int kMostDriven = 1000;  ///< cycles that are counted
/// Ways by which the loops have driven motors since their readings are identical.
struct DrivenWays {
  Joint from{};                          ///< the setpoint then
  Joint error{}, pushed{}, way{};        ///< error that the readings leave; speed and way by it
  std::array<int, kMaxMotors> cycles{};  ///< with such an error

  void begin(int i, Real q_d);

  /// One cycle of motor i. An error at which it may rest drives nothing: friction may have held the
  /// opposite one before. @param off  the law's error; 0: unknown @return its way
  Real advance(const SafetyLimits& limits, int i, Real q_d, Real off, Real rests);
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
struct SafetyShell : SafetyReport {
  SafetyMachine machine;
  bool started = false, acknowledged = false;  ///< requests of the last cycle
  Real since = 0;                              ///< time in this state, s
  Real opening = 0;                            ///< time since the brakes were released, s
  Real halted = 0;      ///< time for which the setpoint of a stop along the path stands still, s
  Real unanswered = 0;  ///< time without an answer, s
  Coordinates at{};     ///< the last setpoint that the law followed,
  Joint weight{};       ///< and the torques that hold the robot there
  FrameClock counter, time;
  unsigned cycle = 0;
  std::array<Joint, kMostWindow> past{};    ///< motor readings of the last cycles
  std::array<int, kMaxMotors> have{};       ///< of these, valid ones without a gap
  int uneven = 0;                           ///< cycles for which a repeated frame is among them
  int same = 0;                             ///< cycles with identical readings of all motors
  Joint pace{};                             ///< their motion per cycle before these
  DrivenWays frame, alone;                  ///< of all motors together, and of each
  std::uint32_t alike = 0;                  ///< motors whose reading is the last one, as bits
  Joint wanted{};                           ///< setpoint of the last cycle
  std::uint32_t unread = 0;                 ///< motors whose reading is missing, as bits
  Joint missing{}, saturated{}, clipped{};  ///< time, s,
  std::uint32_t timed = 0;                  ///< and the causes with times above 0, as bits
};

namespace safety_detail {
inline constexpr Real kLeastPace = 0.02;  ///< smallest motion per cycle that counts, over `still`
inline constexpr int kLongest = 1000;     ///< cycles without a change that are counted
inline constexpr int kFrozen = 3;         ///< identical frames that are one too many
}  // namespace safety_detail

/// One cycle, after the law's: `shell.torque` goes to the motors, `shell.brakes` to the brakes.
/// Usually it costs about 200 instructions per motor; where a stop or a run begins, inverse
/// dynamics at one pose in addition.
void guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
           SafetyShell& shell);
}  // namespace truepose
