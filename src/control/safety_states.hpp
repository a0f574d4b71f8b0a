// The state machine of the safety shell: states, stops, causes and their transitions.
//
// It sees no number, only what the shell found in this cycle (SafetyFindings), so a test enumerates
// it completely. The brakes are open in `running`, and in `stopping` during a stop along the path.
//
//     stopped, fault ──acknowledge, healthy──▶ ready ──start, healthy──▶ running
//     running ──stop or violation──▶ stopping ──brakes closed──▶ stopped, after a violation: fault
//     ready, stopped ──violation──▶ fault
#pragma once

#include <cstdint>

#include "mechanism/sensor_kinds.hpp"

namespace truepose {
enum class SafetyState : int {
  ready = 0,     ///< acknowledged and healthy; brakes closed, waits for a start
  running = 1,   ///< brakes open; the law acts once they have opened
  stopping = 2,  ///< along the path or by brake
  stopped = 3,   ///< after a requested stop, and when switched on; brakes closed
  fault = 4,     ///< after a violation; brakes closed
};

enum class StopKind : int {
  none = 0,
  path = 1,   ///< the loop stays closed while the path slows down; then the brakes close
  brake = 2,  ///< the loop is open; holding torque until the brakes have closed
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
inline constexpr int kCauses = static_cast<int>(kCauseTable.size());

constexpr const CauseProperties& properties(StopCause cause) {
  return kCauseTable[static_cast<std::size_t>(cause)];
}

/// Causes as bits.
constexpr std::uint32_t bit_of(StopCause cause) { return 1U << static_cast<int>(cause); }

/// The causes for which a property holds, as bits.
constexpr std::uint32_t causes_with(bool CauseProperties::* property) {
  std::uint32_t causes = 0;
  for (const CauseProperties& row : kCauseTable)
    if (row.*property) causes |= bit_of(row.cause);
  return causes;
}

/// State, kind of stop, and whether a limit was violated.
struct SafetyMachine {
  SafetyState state = SafetyState::stopped;
  StopKind stop = StopKind::none;  ///< in `stopping`
  bool violated = false;           ///< in `stopping` and `fault`: not only by request
  friend constexpr bool operator==(const SafetyMachine&, const SafetyMachine&) = default;
};

/// What the shell found in one cycle.
struct SafetyFindings {
  bool start = false, stop = false, acknowledge = false;  ///< requests
  bool violated = false;                                  ///< a limit that holds in this state
  bool healthy = false;        ///< all limits are satisfied, also those of a closed loop
  bool trusted = false;        ///< every motor: the loop may stay closed for a stop
  bool path_ended = false;     ///< the stop along the path has had its time
  bool brakes_closed = false;  ///< and the robot has had time to come to rest
};

/// One transition. A machine that is not in one of the states, as after a memory error, is a fault.
constexpr SafetyMachine next(const SafetyMachine& now, const SafetyFindings& found) {
  constexpr SafetyMachine fault{SafetyState::fault, StopKind::none, true};
  const bool healthy = found.healthy && !found.violated && !found.stop;
  switch (now.state) {
    case SafetyState::ready:
      if (found.violated) return fault;
      return {found.start && healthy ? SafetyState::running : SafetyState::ready};
    case SafetyState::running:
      if (!found.stop && !found.violated) return {SafetyState::running};
      return {SafetyState::stopping, found.trusted ? StopKind::path : StopKind::brake,
              found.violated};
    case SafetyState::stopping: {
      const bool violated = now.violated || found.violated;
      if (now.stop == StopKind::path && found.trusted && !found.path_ended)
        return {SafetyState::stopping, StopKind::path, violated};
      if (now.stop == StopKind::path || !found.brakes_closed)
        return {SafetyState::stopping, StopKind::brake, violated};
      return violated ? fault : SafetyMachine{SafetyState::stopped};
    }
    case SafetyState::stopped:
      if (found.violated) return fault;
      return {found.acknowledge && healthy ? SafetyState::ready : SafetyState::stopped};
    case SafetyState::fault:
      return found.acknowledge && healthy ? SafetyMachine{SafetyState::ready} : fault;
  }
  return fault;
}
}  // namespace truepose
