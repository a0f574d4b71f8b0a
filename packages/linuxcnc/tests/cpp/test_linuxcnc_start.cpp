// LinuxCNC's start-up test: miswired machines that are off are named, and hardly move.
#include <memory>

#include "packages/safety/tests/cpp/start_bench.hpp"
#include "src/c/fields.hpp"

extern "C" {
#include "../../hal/start_core.h"
}

using namespace mechanisms;

namespace {

/// An H4 with θ and an elbow encoder, whose drives take torques, behind LinuxCNC's components.
struct Machine {
  explicit Machine(const Robot& robot) : bench(robot), known(bench.prior.known()) {
    truepose_table& table = tej->table;
    c::describe(bench.robot, table.robot);
    table.finest = table.robot;
    table.monitored = 1;
    table.known.count = known.count;
    table.known.column = table.column;
    table.known.root = table.root;
    std::copy_n(known.column, known.count, table.column);
    std::copy_n(known.root, known.count * known.count, table.root);
    std::copy_n(known.sigma.begin(), kMaxReadings, table.known.sigma);
    CHECK(truepose_corrector_begin(tej.get(), &table.robot, 1e-3).status <= TRUEPOSE_OK);
    in.referenced = in.safety = 1;
    std::copy_n(bench.first.begin(), 4, in.q_d);
    std::fill_n(in.error_limit, TRUEPOSE_MOTORS, 0.1);
    std::fill_n(in.largest, TRUEPOSE_MOTORS, 0.1);
  }

  /// One cycle of the component, the drives in the test's hands.
  int cycle(const Miswiring& wrong = {}) {
    Extended q_e = bench.read(wrong);
    for (int k = 0; k < bench.robot.r; ++k)  // a sensor without an index counts from power-on
      if (!(request.known >> k & 1U)) q_e[4 + k] -= bench.first[4 + k] + 0.3;
    std::copy_n(q_e.begin(), kMaxReadings, in.q_e);
    in.proven = !starter->running && starter->reached >= request.level;
    truepose_corrector_cycle(tej.get(), &in);
    const int ended = truepose_starter_cycle(starter.get(), &request, tej.get(), &in);
    Joint torque{};
    if (starter->pulses) std::copy_n(starter->report.torque, 4, torque.begin());
    bench.plant.work_brakes(starter->running ? starter->report.brakes : tej->brakes, 1e-3);
    CHECK(bool(bench.plant.advance(torque, 1e-3, 2)));
    for (int j = 0; j < 3; ++j)
      moved = std::max(moved, std::fabs(bench.plant.pose().D[j] - bench.started.D[j]));
    return ended;
  }
  /// The operator's button, until the test ends.
  void run(const Miswiring& wrong = {}) {
    request.request = 1;
    int cycles = 0;
    while (!cycle(wrong)) CHECK(++cycles < 40000);
    request.request = 0;
    cycle(wrong);
    CHECK(starter->report.brakes == 15 && !starter->running && !starter->pulses);
  }
  bool named(const Miswiring& wrong, StartFinding as) const {
    const truepose_start_report& is = starter->report;
    return is.state == TRUEPOSE_START_FAILED && is.finding == static_cast<int>(as) &&
           is.part == wrong.a && is.other == wrong.b && starter->reached == 0;
  }

  StartBench bench;
  Knowledge known;
  std::unique_ptr<truepose_corrector> tej = std::make_unique<truepose_corrector>();
  std::unique_ptr<truepose_starter> starter = std::make_unique<truepose_starter>();
  truepose_corrector_input in{};
  truepose_starter_input request{.request = 0,
                                 .level = 2,
                                 .brake = 0.02,
                                 .opens = 0.02,
                                 .motion = 0.5e-3,
                                 .homed = 1,
                                 .known = 3};
  double moved = 0;
};
}  // namespace

TEST("a reversed and two exchanged readings are named, and the platform moves below 0.5 mm") {
  const Robot robot = h4_with(2);
  for (const Miswiring& wrong : {Miswiring{StartFinding::reversed, 2, -1, 1, true},
                                 {StartFinding::reversed, 4, -1, 1, true},
                                 {StartFinding::exchanged, 0, 3, 1, true}}) {
    Machine machine(robot);
    machine.run(wrong);
    CHECK(machine.named(wrong, wrong.kind));
    CHECK(machine.moved > 1e-6 && machine.moved < 0.5e-3);
    std::printf("  %s: %.2f mm\n",
                truepose_start_finding_text(static_cast<int32_t>(machine.starter->report.finding)),
                1e3 * machine.moved);
  }
}

TEST("without torques readings are compared at rest: a reversed one is found, no torque acts") {
  const Robot robot = h4_with(2);
  const Miswiring wrong{StartFinding::reversed, 1, -1, 1, false};
  for (const bool healthy : {true, false}) {
    Machine machine(robot);
    machine.request.level = 1;
    machine.run(healthy ? Miswiring{} : wrong);
    CHECK(healthy ? machine.starter->reached == 1
                  : machine.starter->report.state == TRUEPOSE_START_FAILED);
    CHECK(machine.moved < 1e-6);
  }
}

TEST("the shell opens the brakes only after a test of the required level") {
  Machine machine(h4_with(2));
  const auto on = [&] {
    machine.in.enable = 1;
    for (int k = 0; k < 60; ++k) {
      machine.cycle();
      if (machine.tej->brakes == 0) break;
    }
    const bool opened = machine.tej->brakes == 0;
    machine.in.enable = 0;
    machine.cycle();
    return opened;
  };
  CHECK(!on());
  machine.request.level = 1;
  machine.run();
  CHECK(machine.starter->reached == 1);
  machine.request.level = 2;
  CHECK(!on());
  machine.run();
  CHECK(machine.starter->reached == 2 && machine.moved < 0.5e-3);
  CHECK(on());
}

TEST("before a sensor's index is passed a test of either level passes, and the machine goes on") {
  for (const int level : {1, 2})
    for (const std::uint32_t known : {0U, 2U}) {
      Machine machine(h4_with(2));
      machine.request.level = level;
      machine.request.known = known;
      machine.in.referenced = 0;
      machine.run();
      CHECK(machine.starter->reached == level);
      machine.in.enable = 1;
      for (int k = 0; k < 60; ++k) machine.cycle();
      CHECK(machine.tej->brakes == 0 && !machine.tej->inhibit && machine.tej->fault == 0);
    }
}

TEST("a sensor that has not passed its index and is reversed or frozen is named by its motion") {
  for (const StartFinding kind : {StartFinding::reversed, StartFinding::frozen}) {
    Machine machine(h4_with(2));
    machine.request.known = 0;
    machine.in.referenced = 0;
    const Miswiring wrong{kind, 4, -1, 1, true};
    machine.run(wrong);
    CHECK(machine.named(wrong, kind));
  }
}

TEST("while a motor is not homed nothing moves") {
  Machine machine(h4_with(2));
  machine.request.homed = 0;
  machine.run();
  CHECK(machine.starter->report.finding == static_cast<int>(StartFinding::unknown_pose));
  CHECK(machine.moved < 1e-6);
}

TEST("a request while the machine is on begins nothing, and robots without torque limits say so") {
  Machine machine(h4_with(2));
  machine.in.enable = machine.request.request = 1;
  CHECK(machine.cycle() == 0 && !machine.starter->running);
  machine.in.enable = machine.request.request = 0;
  machine.cycle();
  machine.request.brake = std::nan("");
  machine.request.request = 1;
  CHECK(machine.cycle() == 1 && machine.starter->report.finding == 1 && !machine.starter->running);
}

TEST("a payload is observed from the torques that the drives measure, and gone without them") {
  Machine machine(h4_with(2));
  StartBench& bench = machine.bench;
  truepose_table& table = machine.tej->table;
  for (int i = 0; i < 4; ++i) table.known.sigma[i] = bench.robot.chain[i].encoder_step;
  table.monitor = c::converted<truepose_fault_monitor_settings>(FaultMonitorSettings{});
  const ControlSettings drives = settings_for(bench.robot, Law::joint);
  ControlState state;
  bench.plant.disturb({.kind = Disturbance::payload, .size = 2});
  Setpoint home;
  home.x = bench.robot.home;
  machine.in.enable = machine.in.monitor = machine.in.observe = 1;
  for (int k = 0; k < 1000; ++k) {
    const Extended q_e = bench.read({});
    std::copy_n(q_e.begin(), kMaxReadings, machine.in.q_e);
    std::copy_n(state.torque.begin(), 6, machine.in.torque);
    truepose_corrector_cycle(machine.tej.get(), &machine.in);
    CHECK(bool(control(bench.robot, drives, home, q_e, state)));
    bench.plant.work_brakes(0, 1e-3);
    CHECK(bool(bench.plant.advance(state.torque, 1e-3, 2)));
  }
  const truepose_disturbance& seen = machine.tej->disturbance;
  CHECK(seen.kind == TRUEPOSE_PAYLOAD && std::fabs(seen.size - 2) < 0.3);
  machine.in.observe = 0;
  truepose_corrector_cycle(machine.tej.get(), &machine.in);
  CHECK(seen.kind == TRUEPOSE_NO_DISTURBANCE);
}
