// Robots at work: setpoints and readings of control cycles, on robots sampled from their
// tolerances.
#include "at_work.hpp"

#include "full_robots.hpp"
#include "mechanism/geometry.hpp"

namespace mechanisms {
namespace {
Robot sensed(const Mechanism& mechanism, Level level, int sensors) {
  Robot robot = mechanism.robot;
  robot.level = level;
  robot.r = sensors;
  robot.sensor[2] = telemeter({0.05, -0.04, 0.1}, {0, 0.05, -1}, {0.02, 0, 0}, {0.1, 0, 1});
  for (int k = 3; k < 6; ++k) {
    robot.sensor[k].kind = SensorKind::distance;
    robot.sensor[k].origin = polar(0.5, 20 + 110 * k, 0.1);
    robot.sensor[k].target = polar(0.05, 80 * k, 0.01);
  }
  for (int i = 0; i < robot.motors; ++i) robot.chain[i].torque_limit = 100;
  if (!finish(robot) || !finish_full(robot)) std::printf("%s: home fails\n", mechanism.name);
  return robot;
}
}  // namespace

AtWork::AtWork(const Mechanism& mechanism, Level level, int sensors, unsigned seed)
    : robot(sensed(mechanism, level, sensors)),
      truth(robot),
      prior(robot),
      mechanism_(mechanism),
      random_(seed) {
  const Knowledge& known = prior.known();
  const Robot drawn = robot;
  std::vector<double> xi(parameter_count(drawn));
  bool closes = bool(drawn_parameters(drawn, xi.data()));
  for (int i = 0; i < robot.motors; ++i)
    for (const ChainParameter angle : {ChainParameter::yaw, ChainParameter::tilt})
      xi[chain_column(i) + static_cast<int>(angle)] += degrees(0.1) * gaussian(random_);
  for (Robot* of : {&robot, &truth}) {
    for (int k = 0; k < known.count; ++k)
      xi[known.column[k]] += known.root[k * known.count + k] * gaussian(random_);
    closes = closes && set_parameters(drawn, xi.data(), *of) && finish(*of) && finish_full(*of);
  }
  if (!closes) std::printf("%s: the robot does not close\n", mechanism.name);
}

std::vector<AtWork::Cycle> AtWork::motion(int count) {
  const Mobility K = robot.mobility;
  const int n = dof(K);
  const Level level = level_of(robot);
  std::vector<Cycle> cycles;
  Coordinates off{};  // of the robot as built, where the estimate is at x_d
  Parasitic rest;
  const Coordinates phase = random_joint(random_, 3);
  for (int k = -2; k < count; ++k) {
    Cycle cycle;
    Setpoint& at = cycle.setpoint;
    Coordinates stands{};
    for (int i = 0; i < n; ++i) {
      const double size = 0.8 * mechanism_.box[i], omega = 4 - 0.3 * i, angle = omega * 1e-3 * k;
      at.x[i] = robot.home[i] + size * std::sin(angle + phase[i]);
      at.rate[i] = size * omega * std::cos(angle + phase[i]);
      at.acceleration[i] = -size * omega * omega * std::sin(angle + phase[i]);
      stands[i] = 5e-4 * std::sin(30e-3 * k + i) - off[i];
    }
    const Pose desired = to_pose(K, at.x);
    if (!extended(level_of(truth), truth, moved(K, desired, stands), cycle.q_e, &rest))
      std::printf("%s: the path is out of reach\n", mechanism_.name);
    for (int c = 0; c < readings(robot); ++c)
      cycle.q_e[c] = quantized(cycle.q_e[c] + 1e-5 * gaussian(random_), 2e-5);
    if (k >= 0) cycles.push_back(cycle);
    if (k > 0 && k % 20 != 0) continue;
    Pose found = desired;
    if (!estimate(level, robot, prior.known(), cycle.q_e, found, prior.weighing().work)) continue;
    const Coordinates ahead = difference(K, found, desired);
    for (int i = 0; i < n; ++i) off[i] += ahead[i];
  }
  return cycles;
}

Coordinates AtWork::farthest() {
  const int n = dof(robot.mobility);
  Coordinates inside = robot.home, out = robot.home, x;
  for (int i = 0; i < n; ++i) out[i] += random_();
  for (int k = 0; k < 45; ++k) {
    for (int i = 0; i < n; ++i) x[i] = 0.5 * (inside[i] + out[i]);
    Joint q;
    (ikm(Level::ideal, robot, x, q) ? inside : out) = x;
  }
  return x;
}

std::vector<AtWork::Cycle> AtWork::trouble(int count) {
  const Mobility K = robot.mobility;
  const double odd[]{NAN, INFINITY, -INFINITY, 1e300, -1e6};
  std::vector<Cycle> cycles;
  const auto anywhere = [&] { return random_pose(mechanism_, random_); };
  for (int k = 0; k < count; ++k) {
    Cycle cycle;
    const int m = robot.motors, rows = readings(robot), kind = k % 7;
    Coordinates stands = cycle.setpoint.x = anywhere();
    if (kind == 0) stands = anywhere();
    if (kind == 1) cycle.setpoint.x = farthest();
    if (kind == 2) stands = cycle.setpoint.x = farthest();
    if (kind == 3) stands = farthest();
    if (!extended(level_of(truth), truth, to_pose(K, stands), cycle.q_e) &&
        !extended(Level::ideal, robot, to_pose(K, stands), cycle.q_e))
      for (double& value : cycle.q_e) value = 4 * random_();
    double& reading = cycle.q_e[k / 7 % rows];
    if (kind == 4) reading += std::pow(10, 1.75 * random_() - 1.25);  // 1 mm, 1 mrad … 3 m, 3 rad
    if (kind == 5) cycle.q_e[k / 7 % m] += 2 * std::numbers::pi * (k % 9 - 4);
    if (kind == 6 && k % 2 == 0) reading = odd[k % 5];
    if (kind == 6 && k % 4 == 1) cycle.setpoint.x[k / 7 % dof(K)] = odd[k % 5];
    if (kind == 6 && k % 4 == 3)
      for (double& value : cycle.q_e) value = 3 * random_();
    cycles.push_back(cycle);
  }
  return cycles;
}

std::vector<Mechanism> every_rod() {
  return {h4(), delta(), linear_delta(), par4(), hexapod("Hexa", Actuator::revolute)};
}
}  // namespace mechanisms
