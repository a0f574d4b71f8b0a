// The safety shell for C.
#include "c/controllers.hpp"
#include "safety/fields.hpp"
#include "safety/safety_guard.hpp"

using namespace truepose;

namespace truepose::c {
template <>
struct Held<truepose_safety_shell> : InMemory<truepose_safety_shell, 0x5368656CU> {
  SafetyGuard guard;
};
using Shell = Held<truepose_safety_shell>;

namespace {
void mark(const truepose_safety_marks& from, SafetyCycle& cycle) {
  cycle.counter = {from.counter_given != 0, from.counter};
  cycle.time = {from.time_given != 0, from.time};
  cycle.known = from.known != 0;
  cycle.request = {from.start != 0, from.stop != 0, from.acknowledge != 0};
}
}  // namespace
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
const char* truepose_stop_cause_text(int32_t cause) {
  return cause >= 0 && cause < kCauses ? kCauseTable[static_cast<std::size_t>(cause)].name : "";
}

size_t truepose_safety_shell_size(void) { return sizeof(Shell); }

truepose_outcome truepose_safety_shell_init(truepose_safety_shell* shell, size_t size,
                                            const truepose_model* model,
                                            const truepose_safety_limits* limits) {
  return with(model)([&](const Robot& robot) {
    SafetyLimits all;
    Outcome sound = take(*limits, all);
    if (sound) sound = consistent(all, robot.motors, dof(robot.mobility));
    return begun(sound, shell, size, [&](Shell& made) { made.guard.limits = all; });
  });
}

truepose_outcome truepose_control_safely(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, truepose_safety_shell* shell,
    const truepose_setpoint* setpoint, const truepose_real* q_e, const truepose_knowledge* known,
    truepose_real* work, const truepose_safety_marks* marks, truepose_safety_report* report) {
  return with(model, controller, shell)([&](const Robot& robot, Controller& made, Shell& safe) {
    FaultTolerantSetup* setup = monitor ? held(monitor) : nullptr;
    if (monitor && !(setup && monitors(*setup, robot, finest))) return kUnfinished;
    const Known by(robot, known, work, &made.kept, setup || made.weighs());
    if (!by.sound) return by.sound;
    mark(*marks, safe.guard.next);
    const Monitored monitored{setup ? &setup->settings : nullptr, setup ? &setup->state : nullptr,
                              made.late};
    const Outcome outcome =
        control_guarded(robot, made.settings, in<Setpoint>(setpoint), in<Extended>(q_e), made.state,
                        safe.guard, by.weighing, monitored);
    out<GuardReport>(safe.guard.shell, report);
    return outcome;
  });
}

truepose_outcome truepose_guard(const truepose_model* model, truepose_safety_shell* shell,
                                const truepose_safety_cycle* cycle,
                                const truepose_safety_marks* marks,
                                truepose_safety_report* report) {
  return with(model, shell)([&](const Robot& robot, Shell& safe) {
    SafetyCycle core;
    mark(*marks, core);
    core.answer.status = static_cast<Status>(cycle->status);
    core.suspected = cycle->suspected | cycle->lost;
    core.lost = cycle->lost != 0;
    core.disagree = cycle->disagree != 0;
    core.x = in<Coordinates>(cycle->x);
    core.q_d = in<Joint>(cycle->q_d);
    core.q = in<Joint>(cycle->q);
    core.error = in<Joint>(cycle->error);
    core.torque = in<Joint>(cycle->torque);
    core.load = in<Joint>(cycle->load);
    guard(robot, safe.guard.limits, core, safe.guard.shell);
    out<GuardReport>(safe.guard.shell, report);
  });
}
}
