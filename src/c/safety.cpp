// The safety shell for C.
#include "c/controllers.hpp"
#include "control/safety_defaults.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
struct Shell : InMemory<truepose_safety_shell, Shell, 0x5368656CU> {
  SafetyLimits limits;
  SafetyShell shell;
};

SafetyCycle cycle_of(const truepose_safety_marks& from) {
  SafetyCycle cycle;
  cycle.counter = {from.counter_given != 0, from.counter};
  cycle.time = {from.time_given != 0, from.time};
  cycle.known = from.known != 0;
  cycle.request = {from.start != 0, from.stop != 0, from.acknowledge != 0};
  return cycle;
}

void report_on(const SafetyReport& shell, truepose_safety_report* report) {
  *report = converted<truepose_safety_report>(shell);
}
}  // namespace
}  // namespace truepose::c

extern "C" {
const char* truepose_stop_cause_text(int32_t cause) {
  return cause >= 0 && cause < kCauses ? kCauseTable[static_cast<std::size_t>(cause)].name : "";
}

size_t truepose_safety_shell_size(void) { return sizeof(c::Shell); }

truepose_outcome truepose_safety_defaults(const truepose_model* model,
                                          const truepose_control_settings* settings,
                                          truepose_safety_limits* limits) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    ControlSettings all;
    const Status status = c::take(*settings, all);
    if (status != Status::ok) return {status, -1};
    SafetyLimits derived;
    const Outcome outcome = default_limits(robot, all, derived);
    if (outcome) *limits = c::converted<truepose_safety_limits>(derived);
    return outcome;
  });
}

truepose_outcome truepose_stopping_distance(const truepose_model* model,
                                            const truepose_safety_limits* limits, int32_t marked,
                                            truepose_real speed, truepose_real* distance) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    const auto core = c::converted<SafetyLimits>(*limits);
    Outcome outcome = consistent(core, robot.motors, dof(robot.mobility));
    if (outcome && !(speed >= 0 && speed < INFINITY)) outcome = {Status::no_such_value, -1};
    return outcome ? stopping_distance(robot, core, marked != 0, speed, *distance) : outcome;
  });
}

truepose_outcome truepose_safety_shell_init(truepose_safety_shell* shell, size_t size,
                                            const truepose_model* model,
                                            const truepose_safety_limits* limits) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    SafetyLimits all;
    const Status status = c::take(*limits, all);
    if (status != Status::ok) return {status, -1};
    const Outcome outcome = consistent(all, robot.motors, dof(robot.mobility));
    if (!outcome) return outcome;
    c::Shell* made = c::Shell::make(shell, size);
    if (made == nullptr) return c::kTooSmall;
    made->limits = all;
    return {};
  });
}

truepose_outcome truepose_control_safely(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, truepose_safety_shell* shell,
    const truepose_setpoint* setpoint, const truepose_real* q_e, const truepose_knowledge* known,
    truepose_real* work, const truepose_safety_marks* marks, truepose_safety_report* report) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    c::Controller* made = c::Controller::of(controller);
    c::Shell* safe = c::Shell::of(shell);
    c::FaultTolerantSetup* setup = monitor ? c::FaultTolerantSetup::of(monitor) : nullptr;
    if (made == nullptr || safe == nullptr || (monitor && setup == nullptr)) return c::kUnfinished;
    if (setup && !c::monitors(*setup, robot, finest)) return c::kUnfinished;
    const bool weighs = setup || properties(made->settings.law).weighs;
    const c::Known by(robot, known, work, &made->kept, weighs);
    if (!by.sound) return by.sound;
    SafetyCycle cycle = c::cycle_of(*marks);
    const Monitored monitored{setup ? &setup->settings : nullptr, setup ? &setup->state : nullptr,
                              made->late};
    const Outcome outcome = control_safely(
        robot, made->settings, safe->limits, c::converted<Setpoint>(*setpoint),
        c::values<Extended>(q_e), made->state, safe->shell, cycle, by.weighing, monitored);
    c::report_on(safe->shell, report);
    return outcome;
  });
}

truepose_outcome truepose_guard(const truepose_model* model, truepose_safety_shell* shell,
                                const truepose_safety_cycle* cycle,
                                const truepose_safety_marks* marks,
                                truepose_safety_report* report) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    c::Shell* safe = c::Shell::of(shell);
    if (safe == nullptr) return c::kUnfinished;
    SafetyCycle core = c::cycle_of(*marks);
    core.answer.status = static_cast<Status>(cycle->status);
    core.suspected = cycle->suspected | cycle->lost;
    core.lost = cycle->lost != 0;
    core.disagree = cycle->disagree != 0;
    core.x = c::values<Coordinates>(cycle->x);
    core.q_d = c::values<Joint>(cycle->q_d);
    core.q = c::values<Joint>(cycle->q);
    core.error = c::values<Joint>(cycle->error);
    core.torque = c::values<Joint>(cycle->torque);
    core.load = c::values<Joint>(cycle->load);
    guard(robot, safe->limits, core, safe->shell);
    c::report_on(safe->shell, report);
    return {};
  });
}
}
