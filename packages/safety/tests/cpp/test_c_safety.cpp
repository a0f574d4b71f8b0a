// The safety shell in C does what the core's does, and refuses what is no shell.
#include <cstring>

#include "in_c.hpp"
#include "safety/fields.hpp"
#include "safety_bench.hpp"

using namespace mechanisms;

namespace {

/// A robot with torque limits, its controller and its shell as a C program has them.
struct InC {
  explicit InC(const Mechanism& mechanism) : robot(limited_robot(mechanism)) {
    CHECK(same(truepose_safety_defaults(model, &settings, &limits), {}));
    CHECK(same(truepose_safety_shell_init(&shell, sizeof shell, model, &limits), {}));
  }
  truepose_outcome cycle(truepose_safety_marks marks = {}, bool frozen = false) {
    marks.counter_given = marks.known = 1;
    marks.counter = frozen ? frame : ++frame;
    return truepose_control_safely(model, nullptr, &controller, nullptr, &shell, &setpoint,
                                   q_e.data(), nullptr, nullptr, &marks, &report);
  }
  /// From switching on to the law in action.
  void begin() {
    for (int k = 0; k < 10; ++k) cycle();
    truepose_safety_marks marks{};
    marks.acknowledge = 1;
    cycle(marks);
    CHECK(report.state == TRUEPOSE_SAFETY_READY);
    marks.start = 1;
    for (int k = 0; k < 60 && !report.follows; ++k) cycle(marks);
    CHECK(report.state == TRUEPOSE_SAFETY_RUNNING && report.follows && report.brakes == 0);
  }
  Robot robot;
  ModelInC model{robot};
  ControlSettings law = settings_for(robot, Law::joint);
  truepose_control_settings settings = in_c(law);
  truepose_controller controller = controller_in_c(settings);
  truepose_safety_limits limits;
  truepose_safety_shell shell;
  truepose_setpoint setpoint = setpoint_in_c(robot.home);
  Extended q_e = readings_at(robot, robot.home);
  truepose_safety_report report{};
  std::uint64_t frame = 0;
};

}  // namespace

TEST_EACH(
    for_each,
    "a shell in C starts, names a frozen frame in three cycles, and moves on once acknowledged") {
  InC c(mechanism);
  c.begin();
  // The core's shell, one cycle for one cycle.
  ControlState state;
  SafetyGuard guard;
  CHECK(default_limits(c.robot, c.law, guard.limits));
  Setpoint setpoint;
  setpoint.x = c.robot.home;
  for (std::uint64_t frame = 1; frame <= c.frame; ++frame) {
    guard.next.counter = {true, frame};
    guard.next.request = {frame > 11, false, frame > 10};
    static_cast<void>(control_guarded(c.robot, c.law, setpoint, c.q_e, state, guard));
  }
  CHECK(std::equal(guard.shell.torque.begin(), guard.shell.torque.end(), c.report.torque));
  int until = 0;
  while (c.report.state == TRUEPOSE_SAFETY_RUNNING && until < 10) ++until, c.cycle({}, true);
  CHECK(until == 3 && c.report.cause == TRUEPOSE_STOP_STALE_FRAME);
  CHECK(std::string(truepose_stop_cause_text(c.report.cause)) == "stale frame");
  for (int k = 0; k < 10000 && c.report.state != TRUEPOSE_SAFETY_FAULT; ++k) c.cycle();
  CHECK(c.report.brakes == bit(motors) - 1 && !c.report.follows);
  CHECK(c.report.causes == 1U << TRUEPOSE_STOP_STALE_FRAME);
  c.begin();  // acknowledged
}

TEST_EACH(for_each, "the shell alone in C gives what it gives around truepose's law") {
  InC c(mechanism);
  truepose_safety_shell alone;
  CHECK(same(truepose_safety_shell_init(&alone, sizeof alone, c.model, &c.limits), {}));
  ControlState state;  // of any law: the core's
  truepose_safety_report report{};
  for (int k = 0; k < 150; ++k) {
    truepose_safety_marks marks{};
    marks.acknowledge = k > 10;
    marks.start = k > 11;
    marks.known = marks.counter_given = 1;
    if (!report.follows) state = {};
    Setpoint setpoint;
    setpoint.x = c.robot.home;
    const Outcome outcome = control(c.robot, c.law, setpoint, c.q_e, state);
    truepose_safety_cycle cycle{};
    cycle.status = static_cast<int>(outcome.status);
    std::copy_n(setpoint.x.begin(), n, cycle.x);
    std::copy_n(state.q_d.begin(), motors, cycle.q_d);
    std::copy_n(c.q_e.begin(), motors, cycle.q);
    std::copy_n(state.error.begin(), motors, cycle.error);
    std::copy_n(state.torque.begin(), motors, cycle.torque);
    std::copy_n(state.load.begin(), motors, cycle.load);
    c.cycle(marks);
    marks.counter = c.frame;
    CHECK(same(truepose_guard(c.model, &alone, &cycle, &marks, &report), {}));
    CHECK(std::memcmp(&report, &c.report, sizeof report) == 0);
    if (k < 149) continue;
    CHECK(report.follows && report.brakes == 0);
    cycle.lost = 2;
    ++marks.counter;
    CHECK(same(truepose_guard(c.model, &alone, &cycle, &marks, &report), {}));
    CHECK(report.cause == TRUEPOSE_STOP_SUSPECTED_MOTOR && !report.follows);
    alone = {};
    CHECK(same(truepose_guard(c.model, &alone, &cycle, &marks, &report), {Status::unfinished, -1}));
  }
}

TEST("limits that contradict themselves, and a shell that is none, are refused") {
  const Mechanism mechanism = h4();
  InC c(mechanism);
  truepose_safety_limits limits = c.limits;
  const auto begun = [&] {
    return truepose_safety_shell_init(&c.shell, sizeof c.shell, c.model, &limits);
  };
  limits.torque[2] = 0;
  CHECK(same(begun(), {Status::no_such_value, 2}));
  limits = c.limits;
  limits.missing = NAN;
  CHECK(same(begun(), {Status::no_such_value, -1}));
  limits = c.limits;
  ++limits.size;
  CHECK(same(begun(), {Status::other_version, -1}));
  CHECK(same(
      truepose_safety_shell_init(&c.shell, truepose_safety_shell_size() - 1, c.model, &c.limits),
      {Status::too_small, -1}));
  truepose_real distance = 0;
  CHECK(same(truepose_stopping_distance(c.model, &c.limits, 1, 0.3, &distance), {}));
  CHECK(0.003 < distance && distance < 0.1);
  CHECK(same(truepose_stopping_distance(c.model, &c.limits, 1, NAN, &distance),
             {Status::no_such_value, -1}));
  c.shell = {};
  c.report.state = 77;
  CHECK(same(c.cycle(), {Status::unfinished, -1}) && c.report.state == 77);
  CHECK(std::string(truepose_stop_cause_text(19)).empty());
}
