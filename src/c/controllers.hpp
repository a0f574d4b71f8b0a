// Controllers and fault-tolerant controllers in memory from C callers, and their settings.
#pragma once

#include "c/model.hpp"

namespace truepose::c {
template <>
struct Held<truepose_multirate> : InMemory<truepose_multirate, 0x776f6c53U> {
  Multirate late;
};
using SlowSensors = Held<truepose_multirate>;

struct Present;
template <>
struct Held<truepose_controller> : InMemory<truepose_controller, 0x72746e43U> {
  ControlSettings settings;
  ControlState state;
  CachedGain kept;
  Multirate* late = nullptr;  ///< slow and delayed sensors; nullptr: none
  /// Programs that never set it do not link the compensation.
  void (*compensate)(const Robot&, Multirate&, Present&) = nullptr;

  bool weighs() const { return properties(settings.law).weighs; }
};
using Controller = Held<truepose_controller>;

/// Readings of a cycle, slow and delayed ones as of now, and their σ. Without a fault monitor,
/// which has them as they are.
struct Present : Known {
  Extended q_e;
  Knowledge present;

  Present(const Robot& robot, Controller& controller, const truepose_real* read,
          const truepose_knowledge* known, truepose_real* work)
      : Known(robot, known, work, &controller.kept, controller.weighs()), q_e(in<Extended>(read)) {
    if (sound && controller.late) controller.compensate(robot, *controller.late, *this);
  }
};

template <>
struct Held<truepose_fault_monitor> : InMemory<truepose_fault_monitor, 0x72617547U> {
  FaultTolerantSettings settings;
  FaultTolerantState state;
};
using FaultTolerantSetup = Held<truepose_fault_monitor>;

/// Sets the model of a monitor; null: the law's. @return false: not loaded, or of another robot
inline bool monitors(FaultTolerantSetup& setup, const Robot& robot, const truepose_model* finest) {
  const Robot* of = finest ? held(finest) : nullptr;
  if (finest && (of == nullptr || of->mobility != robot.mobility || of->r != robot.r)) return false;
  setup.settings.finest = of;
  return true;
}

/// Whether settings have a value for everything; implemented where they are used.
Outcome sound(const ControlSettings& settings);
Outcome sound(const FaultMonitorSettings& settings);
Outcome sound(const SafetyLimits& limits);

/// Reads settings that an earlier release may have made: members they lack keep their defaults.
template <class Core>
Outcome take(const typename Described<Core>::type& given, Core& all) {
  using C = typename Described<Core>::type;
  if (given.size < offsetof(C, period) || given.size > sizeof given) return Status::other_version;
  std::memcpy(static_cast<void*>(&all), &given, given.size);
  all.size = sizeof given;
  if constexpr (std::is_same_v<Core, ControlSettings>) all.sigma_scale += all.sigma_scale == 0;
  return {};
}
/// The same, and whether they are sound.
template <class Core>
Outcome take_sound(const typename Described<Core>::type& given, Core& all) {
  const Outcome outcome = take(given, all);
  return outcome ? sound(all) : outcome;
}

/// Settings that follow from a robot and its controller's: f(robot, control, found).
template <class Core, class C>
auto derived(const truepose_model* model, const truepose_control_settings* settings, C* to,
             Outcome (*f)(const Robot&, const ControlSettings&, Core&)) {
  return with(model)([&](const Robot& robot) {
    ControlSettings all;
    Outcome outcome = take(*settings, all);
    Core found{};
    if (outcome) outcome = f(robot, all, found);
    if (outcome) out(found, to);
    return outcome;
  });
}
}  // namespace truepose::c
