#include "control/safety_shell.hpp"

namespace truepose {
void guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
           SafetyShell& shell) {
  const int n = dof(robot.mobility);
  safety_detail::Step step{n, limits, cycle, shell};
  ++shell.cycle;
  step.check_frame();
  step.check_stuck();
  step.check_readings();
  step.check_law();
  const bool began = step.transit();
  const SafetyMachine& machine = shell.machine;
  const bool runs = machine.state == SafetyState::running;
  const bool braking = machine.stop == StopKind::brake;

  shell.follows = shell.follows && step.closed();
  if (cycle.answer && step.fresh && (shell.follows || runs)) shell.at = cycle.x;
  if (began && (runs || braking)) {
    Joint weight{};
    if (inverse_dynamics(robot, to_pose(robot.mobility, shell.at), {}, {}, weight))
      shell.weight = weight;
    shell.opening = 0;
  }
  if (shell.follows) {
    const bool closes = cycle.answer && step.fresh;
    step.set_torques(closes ? cycle.torque : cycle.load);
  } else if (runs) {
    // The brakes open once the motors hold the weight, and the law acts once they have opened.
    if (step.set_torques(shell.weight)) shell.opening += limits.period;
    shell.follows = shell.opening > limits.brake;
  } else {
    step.set_torques(braking ? shell.weight : Joint{});
  }
  const bool open = shell.follows || (runs && shell.opening > 0);
  shell.brakes = open ? 0 : bit(n) - 1;
  shell.path_stop = machine.stop == StopKind::path ? limits.stop : 0;
}
}  // namespace truepose
