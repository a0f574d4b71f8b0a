// Limits of a control cycle, and their violations. control/limit_defaults.hpp derives them from a
// robot.
#pragma once

#include "mechanism/robot.hpp"

namespace truepose {
inline constexpr int kMostWindow = 8;     ///< cycles of readings that the checks keep
inline constexpr Real kReaction = 0.010;  ///< s, from a violation to the torques of the stop

/// Limits of one robot under a controller, constant during a run. Motors' values in rad or m and
/// N·m or N; times in s.
struct SafetyLimits {
  std::uint32_t size = sizeof(truepose_safety_limits);  ///< for the C interface
  int window = 1;         ///< cycles over which a motor's speed is measured, 1 to kMostWindow
  int age = 2;            ///< periods by which a frame may be older than the freshest one
  int counter_bits = 32;  ///< of the frame counter, 2 to 64: it wraps
  Real period = 1e-3;
  Real saturation = 0.05;    ///< longest time at the torque limit
  Real clipped = kReaction;  ///< longest time at the slew limit
  Real missing = 0.005;      ///< longest time without a motor's reading,
  Real held = 0.005;         ///< and without an answer of the law
  Real stop = 0.15;          ///< duration of a stop along the path
  Real brake = 0.02;         ///< closing and opening time of a brake (assumed)
  Real standstill = 0.05;    ///< longest time from closed brakes to rest
  Joint torque{};            ///< largest
  Joint slew{};              ///< largest change of the torque, per s
  Joint tracking{};          ///< largest error of the law, ê_q
  Joint deviation{};         ///< largest distance of a reading from its setpoint, q_d - q
  Joint speed{};             ///< largest, of motors and setpoints
  Joint count{};             ///< largest error of a difference of two readings: counts, noise
  /// A frozen frame: identical readings of all motors although one should have moved by `still`.
  Joint still{};
  Joint kp{}, kd{};                   ///< 1/s² and 1/s: the loops that move it,
  Joint rests{};                      ///< beyond an error at which a motor may rest
  Joint low{}, high{};                ///< range of the motors' readings (equal: not tested)
  Coordinates box_low{}, box_high{};  ///< range of the setpoint x (equal: not tested)
};

/// Cause of a stop, or of a refused request. Of several in one cycle the first one is reported:
/// inputs before what follows from them.
enum class StopCause : int {
  none = 0,
  requested = 1,
  contradictory_limits = 2,  ///< see consistent()
  clock_backwards = 3,       ///< the counter or timestamp runs backwards
  dropped_frames = 4,        ///< the counter or timestamp jumps forward
  stale_frame = 5,           ///< readings are repeated or too old
  missing_reading = 6,       ///< a motor gives no number
  unknown_pose = 7,          ///< the motors are not referenced
  suspected_motor = 8,       ///< the fault monitor has lost a motor, or a candidate stands still
  readings_disagree = 9,     ///< the fault monitor isolates no reading; every motor is plausible
  no_answer = 10,            ///< the law has no torque
  workspace = 11,            ///< the setpoint leaves its box
  setpoint_speed = 12,       ///< the setpoint jumps, or moves faster than the speed limit
  motor_range = 13,          ///< a motor is beyond its stops
  overspeed = 14,            ///< a motor is too fast
  tracking_error = 15,       ///< a motor is too far from its setpoint
  torque_rate = 16,          ///< the law's torque exceeds the slew limit for too long
  saturation = 17,           ///< a motor is at its torque limit for too long
  not_ready = 18,            ///< refusal: not in this state
};

/// Properties of a cause.
struct CauseProperties {
  StopCause cause;
  const char* name;
  bool by_path = false;  ///< leaves the motors trusted: the stop may follow the path
  bool always = false;   ///< is a violation also while the brakes are closed
};

/// In the order of StopCause.
inline constexpr std::array kCauseTable{
    CauseProperties{StopCause::none, "none"},
    CauseProperties{StopCause::requested, "requested", true},
    CauseProperties{StopCause::contradictory_limits, "contradictory limits", false, true},
    CauseProperties{StopCause::clock_backwards, "clock backwards", false, true},
    CauseProperties{StopCause::dropped_frames, "dropped frames", false, true},
    CauseProperties{StopCause::stale_frame, "stale frame", false, true},
    CauseProperties{StopCause::missing_reading, "missing reading", false, true},
    CauseProperties{StopCause::unknown_pose, "unknown pose", false, true},
    CauseProperties{StopCause::suspected_motor, "suspected motor", false, true},
    CauseProperties{StopCause::readings_disagree, "readings disagree", true},
    CauseProperties{StopCause::no_answer, "no answer"},
    CauseProperties{StopCause::workspace, "workspace", true},
    CauseProperties{StopCause::setpoint_speed, "setpoint speed"},
    CauseProperties{StopCause::motor_range, "motor range", false, true},
    CauseProperties{StopCause::overspeed, "overspeed", false, true},
    CauseProperties{StopCause::tracking_error, "tracking error"},
    CauseProperties{StopCause::torque_rate, "torque rate"},
    CauseProperties{StopCause::saturation, "saturation"},
    CauseProperties{StopCause::not_ready, "not ready"},
};
static_assert(in_order(kCauseTable, &CauseProperties::cause));
inline constexpr int kCauses = int(kCauseTable.size());

constexpr const CauseProperties& properties(StopCause cause) {
  return kCauseTable[std::size_t(cause)];
}

/// Causes as bits.
constexpr std::uint32_t bit_of(StopCause cause) { return 1U << int(cause); }

/// The causes for which a property holds, as bits.
constexpr std::uint32_t causes_with(bool CauseProperties::* property) {
  std::uint32_t causes = 0;
  for (const CauseProperties& row : kCauseTable)
    if (row.*property) causes |= bit_of(row.cause);
  return causes;
}

/// Checks limits for contradictions in themselves.
/// @return no_such_value, and the motor; -1: a time, a box or a number of cycles
Outcome consistent(const SafetyLimits& limits, int motors, int freedoms);

/// Torques of the next cycle: towards a target, within torque and slew limits. No NaN reaches a
/// motor. @return whether all are what is wanted
bool approach(const SafetyLimits& limits, int motors, const Joint& target, Joint& torque);
}  // namespace truepose
