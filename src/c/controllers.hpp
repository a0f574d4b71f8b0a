// Controllers and fault-tolerant controllers in memory from C callers, and their settings.
#pragma once

#include <algorithm>

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

/// f(monitor), else `unfinished`.
template <class Opaque, class F>
truepose_outcome of_monitor(Opaque* monitor, F&& f) {
  auto* setup = FaultTolerantSetup::of(monitor);
  return answer(setup ? Outcome(f(*setup)) : kUnfinished);
}

/// Sets the model of a monitor; null: the law's. @return false: not loaded, or of another robot
inline bool monitors(FaultTolerantSetup& setup, const Robot& robot, const truepose_model* finest) {
  const Robot* of = finest ? robot_of(finest) : nullptr;
  if (finest && (of == nullptr || of->mobility != robot.mobility || of->r != robot.r)) return false;
  setup.settings.finest = of;
  return true;
}

/// Whether settings have a value for everything; implemented where they are used.
Status status_of(const ControlSettings& settings);
Status status_of(const FaultMonitorSettings& settings);
Status status_of(const MomentumSettings& settings);

/// Reads settings that an earlier release may have made: members they lack keep their defaults.
template <class Core>
Status take(const typename Described<Core>::type& given, Core& all) {
  using C = typename Described<Core>::type;
  if (given.size < offsetof(C, period) || given.size > sizeof given) return Status::other_version;
  std::memcpy(static_cast<void*>(&all), &given, given.size);
  all.size = sizeof given;
  if constexpr (std::is_same_v<Core, ControlSettings>) all.sigma_scale += all.sigma_scale == 0;
  return Status::ok;
}
}  // namespace truepose::c
