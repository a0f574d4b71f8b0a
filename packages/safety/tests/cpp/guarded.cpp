#include "guarded.hpp"

namespace pivots_tested {
Guarded::Guarded(const Mechanism& mechanism)
    : K(mechanism.robot.mobility), n(mechanism.robot.motors), robot(mechanism.robot) {
  CHECK(inverse_dynamics(robot, to_pose(K, robot.home), {}, {}, weight));
  ControlSettings one;
  CHECK(place_poles(robot, robot.home, 1, 1, one));  // kp: the motors' inertia
  for (int i = 0; i < n; ++i) {
    robot.chain[i].torque_limit = 4 * std::fabs(weight[i]) + 200 * one.kp[i];
    robot.chain[i].encoder_step = 1e-5;
  }
  CHECK(default_limits(robot, settings_for(robot, Law::joint), limits));
}

SafetyCycle Guarded::healthy() {
  if (shell.follows) time += limits.period;
  SafetyCycle cycle;
  cycle.x = robot.home;
  for (int j = 0; j < dof(K); ++j) cycle.x[j] += 0.01 * (1 - std::cos((3 + j) * time));
  Closure closure;
  CHECK(ikm(robot, to_pose(K, cycle.x), closure));
  cycle.q_d = closure.q();
  for (int i = 0; i < n; ++i) cycle.q[i] = quantized(cycle.q_d[i], robot.chain[i].encoder_step);
  cycle.torque = cycle.load = weight;
  cycle.counter = {true, ++frame};
  cycle.time = {true, 1'000'000 * frame};
  cycle.request = request;
  return cycle;
}

void Guarded::step(const SafetyCycle& cycle) {
  const SafetyShell before = shell;
  guard(robot, limits, cycle, shell);
  const SafetyState from = before.machine.state, state = shell.machine.state;
  const bool closed = from != SafetyState::running && from != SafetyState::stopping;
  for (int i = 0; i < n; ++i) {
    const double torque = shell.torque[i], last = before.torque[i], holds = shell.weight[i];
    CHECK(std::fabs(torque) <= limits.torque[i]);
    CHECK(std::fabs(torque - last) <= limits.slew[i] * limits.period * (1 + 1e-9));
    if (!shell.brakes) continue;
    // Towards the holding torque or zero; and never beyond it against a closed brake.
    CHECK(torque >= std::min({last, holds, 0.0}) && torque <= std::max({last, holds, 0.0}));
    if (closed) CHECK(std::fabs(torque) <= std::max(std::fabs(holds), std::fabs(before.weight[i])));
  }
  CHECK(shell.brakes == 0 || shell.brakes == bit(n) - 1);
  if (shell.brakes == 0)
    CHECK(state == SafetyState::running || shell.machine.stop == StopKind::path);
  const bool acknowledged = cycle.request.acknowledge && !before.acknowledged;
  const bool started = cycle.request.start && !before.started;
  if (state == SafetyState::running && from != SafetyState::running)
    CHECK(from == SafetyState::ready && started);
  if (state == SafetyState::ready && from != SafetyState::ready)
    CHECK(acknowledged && shell.causes == 0);
  if (from == SafetyState::fault && state == SafetyState::fault)
    CHECK(shell.cause == before.cause && (shell.causes & before.causes) == before.causes);
  if (state == SafetyState::fault || shell.machine.violated)
    CHECK(shell.causes != 0 && shell.cause != StopCause::none);
  if (shell.follows) CHECK(shell.brakes == 0);
  CHECK((shell.path_stop > 0) == (shell.machine.stop == StopKind::path));
}

void Guarded::run_for(int count) {
  for (int k = 0; k < count; ++k) step(healthy());
}

void Guarded::press(bool SafetyRequests::* button) {
  request.*button = true;
  run_for(1);
  request.*button = false;
}

void Guarded::to_ready() {
  run_for(10);
  press(&SafetyRequests::acknowledge);
  CHECK(shell.machine.state == SafetyState::ready);
}

void Guarded::to_running() {
  to_ready();
  press(&SafetyRequests::start);
  CHECK(shell.machine.state == SafetyState::running);
  run_for(60);
  CHECK(shell.follows && shell.machine.state == SafetyState::running);
}

int Guarded::rest() const {
  return static_cast<int>((limits.stop + limits.brake + limits.standstill) / limits.period) + 20;
}

int Guarded::until_stop(int most, const std::function<void(SafetyCycle&, int)>& change) {
  for (int k = 1; k <= most; ++k) {
    SafetyCycle cycle = healthy();
    change(cycle, k);
    step(cycle);
    if (shell.machine.state != SafetyState::running) return k;
  }
  return -1;
}

void for_some_guarded(const std::function<void(const Mechanism&)>& f) {
  for_all({h4(), delta(), hexapod("6-UPS", Actuator::telescopic), g1_ankle(), lever()}, f);
}
}  // namespace pivots_tested
