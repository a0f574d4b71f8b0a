// Checks of a control cycle against its limits: finite readings, range, speed, age of frames,
// motors that stand still while their loop drives them, following error, workspace, torques.
//
// They trust no reading. Bounded work, no allocation, exception or lock.
#pragma once

#include <bit>

#include "control/driven_way.hpp"
#include "control/frame_clock.hpp"
#include "control/limits.hpp"
#include "control/parity.hpp"

namespace truepose {
/// What is checked in one cycle.
struct CheckedCycle {
  Coordinates x{};           ///< pose of the setpoint
  Joint q_d{};               ///< desired motor readings
  Joint q{};                 ///< motor readings
  Outcome answer;            ///< of the law
  Joint torque{};            ///< its torque
  Joint error{};             ///< ê_q
  FrameMark counter;         ///< of the readings' frame,
  FrameMark time;            ///< and its timestamp, ns
  std::uint32_t unused = 0;  ///< motors whose readings the law does not use, as bits
};

/// What a cycle's checks found: violations as bits, each with the motor that was first.
struct Violations {
  bool fresh = true;  ///< the frame is new
  std::uint32_t causes = 0;
  std::array<int, kCauses> part;

  void add(bool violated, StopCause cause, int motor = -1);
  StopCause first() const { return static_cast<StopCause>(std::countr_zero(causes | 1U << 31)); }
};

/// State of the checks, the caller's; a new one starts afresh.
struct LimitState {
  FrameClock counter, time;
  Real unanswered = 0;  ///< time without an answer, s
  unsigned cycle = 0;
  std::array<Joint, kMostWindow> past{};  ///< motor readings of the last cycles
  std::array<int, kMaxMotors> have{};     ///< of these, valid ones without a gap
  int uneven = 0;                         ///< cycles for which a repeated frame is among them
  int same = 0;                           ///< cycles with identical readings of all motors
  Joint pace{};                           ///< their motion per cycle before these
  /// While the readings of all motors are identical, and of each.
  std::array<DrivenWay, kMaxMotors> frame, alone;
  std::uint32_t alike = 0;                  ///< motors whose reading is the last one, as bits
  Joint wanted{};                           ///< setpoint of the last cycle
  std::uint32_t unread = 0;                 ///< motors whose reading is missing, as bits
  Joint missing{}, saturated{}, clipped{};  ///< time, s,
  std::uint32_t timed = 0;                  ///< and the causes with times above 0, as bits

  /// Whether all motors have been read without a gap for as long as their speeds are measured.
  bool seen(int motors) const;
};

namespace safety_detail {
inline constexpr Real kLeastPace = 0.02;  ///< smallest motion per cycle that counts, over `still`
inline constexpr int kFrozen = 3;         ///< identical frames that are one too many
}  // namespace safety_detail

/// Checks one cycle, after the law's. Setpoints, torques and frozen readings are checked only while
/// the law acts. Usually it costs about 150 instructions per motor.
/// @param acts  whether the law acts @param applied  torques of the last cycle
Violations check_limits(int motors, int freedoms, const SafetyLimits& limits,
                        const CheckedCycle& cycle, bool acts, const Joint& applied,
                        LimitState& state);
}  // namespace truepose
