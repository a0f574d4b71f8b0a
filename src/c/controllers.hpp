// Controllers and fault-tolerant controllers in memory from C callers, and their settings.
#pragma once

#include <cstddef>

#include "c/description.hpp"
#include "c/model.hpp"

namespace truepose::c {
struct SlowSensors : InMemory<truepose_multirate, SlowSensors, 0x776f6c53U> {
  Multirate late;
};

struct Present;
struct Controller : InMemory<truepose_controller, Controller, 0x72746e43U> {
  ControlSettings settings;
  ControlState state;
  CachedGain kept;
  Multirate* late = nullptr;  ///< slow and delayed sensors; nullptr: none
  /// Programs that never set it do not link the compensation.
  void (*compensate)(const Robot&, Multirate&, Present&) = nullptr;
};

/// Readings of a cycle, slow and delayed ones as of now, and their σ. Without a fault monitor,
/// which has them as they are.
struct Present {
  Extended q_e;
  Knowledge known;
  Weighing weighing;

  Present(const Robot& robot, const Controller& controller, const truepose_real* read,
          const Weighing& by)
      : q_e(values<Extended>(read)), weighing(by) {
    if (controller.late) controller.compensate(robot, *controller.late, *this);
  }
  Present(const Present&) = delete;
  Present& operator=(const Present&) = delete;
};

struct FaultTolerantSetup : InMemory<truepose_fault_monitor, FaultTolerantSetup, 0x72617547U> {
  FaultTolerantSettings settings;
  FaultTolerantState state;
};

/// Sets the model of a monitor; null: the law's. @return false: not loaded, or of another robot
inline bool monitors(FaultTolerantSetup& setup, const Robot& robot, const truepose_model* finest) {
  const Model* of = finest ? Model::of(finest) : nullptr;
  if (finest && (of == nullptr || of->robot.mobility != robot.mobility || of->robot.r != robot.r))
    return false;
  setup.settings.finest = of ? &of->robot : nullptr;
  return true;
}

inline ControlSettings of_c(const truepose_control_settings& from) {
  ControlSettings settings;
  fields(from, settings, Copy<true>{});
  settings.sigma_scale = std::max(settings.sigma_scale, 1);
  return settings;
}

/// Reads settings that an earlier release may have made: members they lack have their defaults.
template <class C, class Core>
Status take(const C& given, const Core& defaults, C& all) {
  describe(defaults, all);
  if (given.size < offsetof(C, period) || given.size > sizeof all) return Status::other_version;
  std::memcpy(&all, &given, given.size);
  return Status::ok;
}

inline constexpr Outcome kUnfinished{Status::unfinished, -1};
}  // namespace truepose::c
