// The observer of external forces for C.
#include "c/controllers.hpp"
#include "control/momentum_defaults.hpp"

using namespace truepose;

namespace truepose::c {
Status status_of(const MomentumSettings& s) {
  if (!finite(s)) return Status::not_finite;
  bool good = s.period >= 0 && s.share >= 0;
  for (const Real number : {s.bandwidth, s.alarm, s.named, s.kept, s.window, s.over})
    good = good && number > 0;
  for (int i = 0; i < kMaxMotors; ++i) good = good && s.sigma[i] >= 0 && s.give[i] >= 0;
  return good ? Status::ok : Status::no_such_value;
}
}  // namespace truepose::c

extern "C" {
truepose_outcome truepose_momentum_defaults(const truepose_model* model,
                                            const truepose_control_settings* settings,
                                            truepose_momentum_settings* momentum) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    ControlSettings all;
    const Status status = c::take(*settings, all);
    if (status != Status::ok) return {status, -1};
    MomentumSettings derived;
    const Outcome outcome = default_momentum(robot, all, derived);
    if (outcome) *momentum = c::converted<truepose_momentum_settings>(derived);
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_momentum(truepose_fault_monitor* monitor,
                                                 const truepose_momentum_settings* momentum) {
  return c::of_monitor(monitor, [&](c::FaultTolerantSetup& setup) -> Outcome {
    MomentumSettings all;
    all.period = 0;
    Status status = momentum ? c::take(*momentum, all) : Status::ok;
    if (status == Status::ok) status = c::status_of(all);
    if (status != Status::ok) return {status, -1};
    setup.settings.momentum = all;
    setup.state.observer = {};
    return {};
  });
}

truepose_outcome truepose_fault_monitor_observe(const truepose_model* model,
                                                truepose_fault_monitor* monitor,
                                                const truepose_real* torque) {
  return c::asked(model, [&](const Robot& robot) {
    c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
    if (setup == nullptr) return c::kUnfinished;
    observe_forces(robot, setup->settings, setup->settings.monitor.period, true,
                   c::values<Joint>(torque), setup->state);
    return Outcome{};
  });
}

truepose_outcome truepose_fault_monitor_disturbance(const truepose_fault_monitor* monitor,
                                                    truepose_disturbance* disturbance) {
  return c::of_monitor(monitor, [&](const c::FaultTolerantSetup& setup) {
    const DisturbanceReport& seen = setup.state.observer;
    *disturbance = c::converted<truepose_disturbance>(seen);
    return Outcome{};
  });
}
}
