// The observer of external forces for C.
#include "c/controllers.hpp"
#include "control/momentum_defaults.hpp"

using namespace truepose;

namespace truepose::c {
Outcome sound(const MomentumSettings& s) {
  if (!finite(s)) return {Status::not_finite};
  bool good = s.period >= 0 && s.share >= 0;
  for (const Real number : {s.bandwidth, s.alarm, s.named, s.kept, s.window, s.over})
    good = good && number > 0;
  for (int i = 0; i < kMaxMotors; ++i) good = good && s.sigma[i] >= 0 && s.give[i] >= 0;
  return {good ? Status::ok : Status::no_such_value};
}
}  // namespace truepose::c

extern "C" {
truepose_outcome truepose_momentum_defaults(const truepose_model* model,
                                            const truepose_control_settings* settings,
                                            truepose_momentum_settings* momentum) {
  return c::derived(model, settings, momentum, default_momentum);
}

truepose_outcome truepose_fault_monitor_momentum(truepose_fault_monitor* monitor,
                                                 const truepose_momentum_settings* momentum) {
  return c::with(monitor)([&](c::FaultTolerantSetup& setup) {
    MomentumSettings all;
    all.period = 0;
    const Outcome outcome = momentum ? c::take_sound(*momentum, all) : Outcome{};
    if (!outcome) return outcome;
    setup.settings.momentum = all;
    setup.state.observer = {};
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_observe(const truepose_model* model,
                                                truepose_fault_monitor* monitor,
                                                const truepose_real* torque) {
  return c::with(model, monitor)([&](const Robot& robot, c::FaultTolerantSetup& setup) {
    observe_forces(robot, setup.settings, setup.settings.monitor.period, true, c::in<Joint>(torque),
                   setup.state);
    return Outcome{};
  });
}

truepose_outcome truepose_fault_monitor_disturbance(const truepose_fault_monitor* monitor,
                                                    truepose_disturbance* disturbance) {
  return c::with(monitor)([&](const c::FaultTolerantSetup& setup) {
    c::out<DisturbanceReport>(setup.state.observer, disturbance);
    return Outcome{};
  });
}
}
