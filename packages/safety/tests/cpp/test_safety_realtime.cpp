// A safety shell that neither allocates nor blocks.
#include "control/limit_defaults.hpp"
#include "realtime.hpp"
#include "safety/safety_guard.hpp"

TEST_EACH(for_each, "no safety shell does, whatever stops it, with a fault monitor and without") {
  Scene made(mechanism, 0);
  const ControlSettings settings = settings_for(made.robot, Law::joint);
  SafetyLimits limits;
  CHECK(default_limits(made.robot, settings, limits));
  limits.standstill = 0.05;
  FaultTolerantSettings faults;
  prepare(faults.monitor);
  for (const bool is_monitored : {false, true}) {
    FaultTolerantState fault_state;
    Monitored monitored;
    if (is_monitored) monitored = {&faults, &fault_state, nullptr};
    ControlState state;
    SafetyGuard guard;
    guard.limits = limits;
    long stops = 0;
    const long follows = watched(3000, [&](long k) {
      guard.next.request = {k % 300 == 21, false, k % 300 == 20};
      if (k % 300 == 20 && is_monitored) acknowledge(fault_state, -1);
      Setpoint setpoint;
      setpoint.x = made.robot.home;
      Extended q_e = made.at(k).q_e;
      if (k % 300 > 100) q_e[0] = k % 600 > 300 ? NAN : 3;
      static_cast<void>(control_guarded(made.robot, settings, setpoint, q_e, state, guard,
                                        made.prior.weighing(), monitored));
      stops += guard.shell.machine.state == SafetyState::fault;
      return guard.shell.follows;
    });
    CHECK(is_monitored || follows > 100);
    CHECK(stops > 100);
  }
}
