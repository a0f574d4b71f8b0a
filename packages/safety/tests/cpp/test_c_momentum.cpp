// The momentum observer in C picks up a payload as the core does.
#include "in_c.hpp"
#include "safety/fields.hpp"
#include "safety/momentum_defaults.hpp"
#include "safety_bench.hpp"

using namespace mechanisms;

namespace {
int observe(truepose_fault_monitor& monitor, truepose_momentum_observer& observer,
            const truepose_momentum_settings* momentum) {
  return truepose_fault_monitor_momentum(&monitor, &observer, sizeof observer, momentum).status;
}
}  // namespace

TEST("a payload in C has the core's size and torques, is fed forward, and drives may observe it") {
  constexpr Mobility K = Mobility::schoenflies;
  const Robot robot = limited_robot(h4());
  const ModelInC model(robot);
  KnownInC known(robot);
  for (int i = 0; i < 4; ++i)
    known.prior.known().sigma[i] = known.table.sigma[i] = robot.chain[i].encoder_step;
  truepose_momentum_settings momentum{};
  truepose_fault_monitor monitor{}, alone;
  truepose_momentum_observer observer, of_drives;
  truepose_fault_report report;
  const ControlSettings control_settings = settings_for(robot, Law::joint);
  const auto settings = in_c(control_settings);
  truepose_controller controller = controller_in_c(settings);
  FaultTolerantSettings core;
  prepare(core.monitor);
  CHECK(observe(monitor, observer, &momentum) == TRUEPOSE_UNFINISHED);
  monitor = monitor_in_c(core);
  CHECK(observe(monitor, observer, &momentum) == TRUEPOSE_OTHER_VERSION);
  CHECK(truepose_momentum_defaults(model, &settings, &momentum).status == 0);
  momentum.alarm = 0;
  CHECK(observe(monitor, observer, &momentum) == TRUEPOSE_NO_SUCH_VALUE);
  momentum.alarm = MomentumSettings{}.alarm;
  momentum.carry = 1;
  CHECK(observe(monitor, observer, &momentum) == 0);
  CHECK(truepose_fault_monitor_momentum(&monitor, &of_drives, 8, &momentum).status ==
        TRUEPOSE_TOO_SMALL);
  alone = monitor;
  CHECK(observe(alone, of_drives, &momentum) == 0);
  MomentumSupervisor watching;
  CHECK(bool(default_momentum(robot, control_settings, watching.settings)));
  watching.settings.carry = true;
  core.supervisor = &watching;

  ControlState state;
  FaultTolerantState fault_state;
  Plant plant(robot, {}, to_pose(K, robot.home), 1);
  CHECK(plant.rest());
  plant.disturb({.kind = Disturbance::payload, .size = 2});
  truepose_disturbance seen{}, by_drives{};
  truepose_real torque[TRUEPOSE_MOTORS] = {}, believed[kMaxReadings];
  double sagged = 0, sag = 0;
  for (int k = 0; k < 1500; ++k) {
    Setpoint setpoint;
    setpoint.x = robot.home;
    const truepose_setpoint to = setpoint_in_c(setpoint.x);
    Extended q_e{};
    CHECK(plant.measure(q_e));
    CHECK(truepose_fault_monitor_step(model, &alone, state.q_d.data(), q_e.data(), known,
                                      known.work.data(), believed, &report)
              .status <= 0);
    if (state.started) CHECK(truepose_fault_monitor_observe(model, &alone, torque).status == 0);
    CHECK(truepose_control_fault_tolerant(model, nullptr, &controller, &monitor, &to, q_e.data(),
                                          known, known.work.data(), torque, &report)
              .status <= 0);
    CHECK(bool(control_fault_tolerant(robot, control_settings, core, setpoint, q_e, state,
                                      known.prior.weighing(), fault_state)));
    CHECK(std::equal(state.torque.begin(), state.torque.end(), torque));
    CHECK(truepose_fault_monitor_disturbance(&monitor, &seen).status == 0);
    CHECK(seen.size == watching.state.size && seen.chi2 == watching.state.chi2);
    CHECK(plant.advance(state.torque, 1e-3, 2));
    sag = std::fabs(plant.pose().D[2] - robot.home[2]);
    sagged = std::max(sagged, sag);
  }
  CHECK(truepose_fault_monitor_disturbance(&alone, &by_drives).status == 0);
  CHECK(seen.kind == TRUEPOSE_PAYLOAD && std::fabs(seen.size - 2) < 0.1 && !seen.refused);
  CHECK(by_drives.kind == TRUEPOSE_PAYLOAD && std::fabs(by_drives.size - seen.size) < 1e-3);
  CHECK(std::fabs(seen.force[2] + 2 * 9.81) < 1 && sag < 0.1 * sagged);
  CHECK(observe(monitor, observer, nullptr) == 0);
  CHECK(truepose_fault_monitor_disturbance(&monitor, &seen).status == 0 && seen.kind == 0);
}
