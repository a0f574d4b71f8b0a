// The state machine of the safety shell: states, stops, causes and their transitions.
//
// It sees no number, only what the shell found in this cycle (SafetyFindings), so a test enumerates
// it completely. The brakes are open in `running`, and in `stopping` during a stop along the path.
//
//     stopped, fault ──acknowledge, healthy──▶ ready ──start, healthy──▶ running
//     running ──stop or violation──▶ stopping ──brakes closed──▶ stopped, after a violation: fault
//     ready, stopped ──violation──▶ fault
#pragma once

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
