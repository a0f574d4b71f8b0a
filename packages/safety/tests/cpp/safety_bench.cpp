#include "safety_bench.hpp"

namespace mechanisms {
Robot limited_robot(const Mechanism& mechanism) {
  Robot robot = mechanism.robot;
  ControlSettings one;
  Joint weight{};
  CHECK(place_poles(robot, robot.home, 1, 1, one));  // kp: the motors' inertia
  CHECK(hold(robot, to_pose(robot.mobility, robot.home), weight));
  for (int i = 0; i < robot.motors; ++i) {
    const bool turns = robot.chain[i].actuator == Actuator::revolute;
    robot.chain[i].torque_limit = 4 * std::fabs(weight[i]) + (turns ? 600 : 200) * one.kp[i];
    robot.chain[i].encoder_step = turns ? 2 * std::numbers::pi / 14400 : 1e-5;
  }
  for (int k = 0; k < robot.r; ++k) robot.sensor[k].step = 1e-5;
  return robot;
}

Robot true_robot(Robot robot, const Reality& reality) {
  for (int i = 0; i < robot.motors; ++i) robot.chain[i].rod += reality.length * (i % 3 - 1);
  return robot;
}

Effects effects_of(const Robot& robot, const Reality& reality) {
  Effects effects;
  for (int i = 0; i < robot.motors; ++i)
    effects.friction[i] = reality.friction * robot.chain[i].torque_limit;
  effects.ripple = reality.ripple;
  return effects;
}

Bench::Bench(const Mechanism& mechanism, Law law, FeedForward forward, const Reality& reality)
    : K(mechanism.robot.mobility),
      n(mechanism.robot.motors),
      robot(limited_robot(mechanism)),
      truth(true_robot(robot, reality)),
      prior(robot),
      plant(truth, effects_of(robot, reality), to_pose(K, robot.home), 1),
      from(robot.home),
      to(robot.home) {
  settings = settings_for(robot, law);
  if (forward != FeedForward{}) settings.feed_forward = forward;
  CHECK(default_limits(robot, settings, limits));
  CHECK(plant.rest());
}

void Bench::cycle(const Spoil& spoil) {
  Setpoint setpoint = clock.paced(quintic(K, from, to, duration, clock.time));
  Extended q_e{};
  CHECK(plant.measure(q_e));
  SafetyCycle& now = guard.next = {};
  now.counter = {true, ++frame};
  now.request = request;
  if (spoil) spoil(q_e, now, setpoint);
  const Joint before = shell.torque;
  static_cast<void>(
      control_guarded(robot, settings, setpoint, q_e, state, guard, prior.weighing(), monitored));
  for (int i = 0; i < n; ++i) {
    CHECK(std::fabs(shell.torque[i]) <= limits.torque[i]);
    CHECK(std::fabs(shell.torque[i] - before[i]) <= limits.slew[i] * limits.period * (1 + 1e-9));
  }
  ran = ran || shell.follows;
  if (shell.follows) clock.advance(settings.period, shell.path_stop);
  if (!ran) return;  // its brakes hold it
  plant.brake(shell.brakes, settings.period);
  CHECK(plant.advance(shell.torque, settings.period, 2));
}

int Bench::cycles(int most, const std::function<bool()>& until, const Spoil& spoil) {
  for (int k = 0; k <= most; ++k) {
    if (until()) return k;
    cycle(spoil);
  }
  return -1;
}

void Bench::run_for(int count, const Spoil& spoil) {
  for (int k = 0; k < count; ++k) cycle(spoil);
}

void Bench::begin() {
  run_for(10);
  request.acknowledge = true;
  cycle();
  CHECK(shell.machine.state == SafetyState::ready);
  request.start = true;
  CHECK(cycles(60, [&] { return shell.follows; }) > 0);
  CHECK(shell.brakes == 0);
  request = {};
}

void Bench::move(const Coordinates& target, double time) {
  from = clock.time > 0 ? to : robot.home;
  to = target;
  duration = time;
  clock = {};
}

double Bench::travelled(const Pose& since) const {
  double sum = 0;
  for (int j = 0; j < positions_of(K); ++j) sum += std::pow(plant.pose().D[j] - since.D[j], 2);
  return std::sqrt(sum);
}
}  // namespace mechanisms
