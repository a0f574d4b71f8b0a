// The observer of external forces for C.
#include "c/controllers.hpp"
#include "safety/fields.hpp"
#include "safety/momentum_defaults.hpp"

using namespace truepose;

namespace truepose::c {
template <>
struct Held<truepose_momentum_observer> : InMemory<truepose_momentum_observer, 0x746e6d4dU> {
  MomentumSupervisor observer;
};
using Observer = Held<truepose_momentum_observer>;

Outcome sound(const MomentumSettings& s) {
  if (!finite(s)) return {Status::not_finite};
  bool good = s.period >= 0 && s.share >= 0;
  for (const Real number : {s.bandwidth, s.alarm, s.named, s.kept, s.window, s.over})
    good = good && number > 0;
  for (int i = 0; i < kMaxMotors; ++i) good = good && s.sigma[i] >= 0 && s.give[i] >= 0;
  return {good ? Status::ok : Status::no_such_value};
}
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
size_t truepose_momentum_observer_size(void) { return sizeof(Observer); }

truepose_outcome truepose_momentum_defaults(const truepose_model* model,
                                            const truepose_control_settings* settings,
                                            truepose_momentum_settings* momentum) {
  return derived(model, settings, momentum, default_momentum);
}

truepose_outcome truepose_fault_monitor_momentum(truepose_fault_monitor* monitor,
                                                 truepose_momentum_observer* observer, size_t size,
                                                 const truepose_momentum_settings* momentum) {
  return with(monitor)([&](FaultTolerantSetup& setup) {
    MomentumSettings all;
    const Outcome outcome = momentum ? take(*momentum, all) : Outcome{};
    if (!outcome || !momentum) {
      if (outcome) setup.settings.supervisor = nullptr;
      return outcome;
    }
    return begun(sound(all), observer, size, [&](Observer& made) {
      made.observer.settings = all;
      setup.settings.supervisor = &made.observer;
    });
  });
}

truepose_outcome truepose_fault_monitor_observe(const truepose_model* model,
                                                truepose_fault_monitor* monitor,
                                                const truepose_real* torque) {
  return with(model, monitor)([&](const Robot& robot, FaultTolerantSetup& setup) {
    if (Supervisor* const supervisor = setup.settings.supervisor)
      supervisor->observe(robot, setup.settings.monitor.period, !setup.state.stops,
                          in<Joint>(torque), setup.state.monitor);
  });
}

truepose_outcome truepose_fault_monitor_disturbance(const truepose_fault_monitor* monitor,
                                                    truepose_disturbance* disturbance) {
  return with(monitor)([&](const FaultTolerantSetup& setup) {
    const Supervisor* const supervisor = setup.settings.supervisor;
    out(supervisor ? supervisor->disturbance() : DisturbanceReport{}, disturbance);
  });
}
}
