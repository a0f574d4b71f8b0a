// The observer of external forces for C.
#include "c/controllers.hpp"
#include "control/momentum_defaults.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
Status status_of(const truepose_momentum_settings& s) {
  if (!finite(s, MomentumSettings{})) return Status::not_finite;
  bool good = s.period >= 0 && s.share >= 0;
  for (const truepose_real number : {s.bandwidth, s.alarm, s.named, s.kept, s.window, s.over})
    good = good && number > 0;
  for (int i = 0; i < kMaxMotors; ++i) good = good && s.sigma[i] >= 0 && s.give[i] >= 0;
  return good ? Status::ok : Status::no_such_value;
}
}  // namespace
}  // namespace truepose::c

extern "C" {
truepose_outcome truepose_momentum_defaults(const truepose_model* model,
                                            const truepose_control_settings* settings,
                                            truepose_momentum_settings* momentum) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    truepose_control_settings all;
    const Status status = c::take(*settings, ControlSettings{}, all);
    if (status != Status::ok) return {status, -1};
    MomentumSettings derived;
    const Outcome outcome = default_momentum(robot, c::of_c(all), derived);
    if (outcome) c::describe(derived, *momentum);
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_momentum(truepose_fault_monitor* monitor,
                                                 const truepose_momentum_settings* momentum) {
  c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
  if (setup == nullptr) return c::answer(c::kUnfinished);
  truepose_momentum_settings all;
  MomentumSettings core;
  core.period = 0;
  if (momentum) {
    Status status = c::take(*momentum, core, all);
    if (status == Status::ok) status = c::status_of(all);
    if (status != Status::ok) return c::answer({status, -1});
    c::fields(all, core, c::Copy<true>{});
  }
  setup->settings.momentum = core;
  setup->state.observer = {};
  return c::answer({});
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
  const c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
  if (setup == nullptr) return c::answer(c::kUnfinished);
  const MomentumObserver& seen = setup->state.observer;
  *disturbance = {static_cast<std::int32_t>(seen.disturbance),
                  seen.motor,
                  seen.refused,
                  seen.size,
                  seen.sigma,
                  seen.chi2,
                  {}};
  c::give(seen.force, disturbance->force);
  return c::answer({});
}
}
