#include "start_bench.hpp"

namespace mechanisms {
Robot rubbing(Robot robot, const Truth& truth) {
  for (int i = 0; i < robot.motors; ++i) {
    Chain& chain = robot.chain[i];
    chain.coulomb = 0.005 * chain.torque_limit * truth.friction;
    chain.rod_mass *= truth.mass;
  }
  for (int k = 0; k < robot.bodies; ++k) {
    robot.body[k].mass *= truth.mass;
    robot.body[k].inertia = truth.mass * robot.body[k].inertia;
  }
  return robot;
}

StartBench::StartBench(const Robot& nominal, const Truth& is, const Coordinates* from,
                       double period)
    : K(nominal.mobility),
      n(nominal.motors),
      robot(rubbing(nominal, {})),
      truth(rubbing(nominal, is)),
      prior(robot),
      started(to_pose(K, from ? *from : robot.home)),
      plant(truth, {}, started, 1),
      real(is) {
  ControlSettings control = settings_for(robot, Law::joint);
  control.period = period;
  CHECK(default_limits(robot, control, limits));
  CHECK(plant.rest());
  plant.engage();
  static_cast<void>(plant.measure(first));
}

Extended StartBench::read(const Miswiring& wrong) {
  Extended q_e{};
  CHECK(bool(plant.measure(q_e)));
  const Extended zero =
      wrong.incremental || wrong.kind == StartFinding::frozen ? first : Extended{};
  const Extended healthy = q_e;
  const auto shows = [&](int to, int from, double gain) {
    q_e[to] = zero[to] + gain * (healthy[from] - zero[from]);
  };
  if (wrong.kind == StartFinding::reversed) shows(wrong.a, wrong.a, -1);
  if (wrong.kind == StartFinding::scale) shows(wrong.a, wrong.a, wrong.gain);
  if (wrong.kind == StartFinding::frozen) shows(wrong.a, wrong.a, 0);
  if (wrong.kind == StartFinding::exchanged) {
    shows(wrong.a, wrong.b, 1);
    shows(wrong.b, wrong.a, 1);
  }
  return q_e;
}

void StartBench::run(const Miswiring& wrong, bool known) {
  int cycles = 0;
  for (; cycles < 100000; ++cycles) {
    Extended q_e = read(wrong);
    if (spoil) spoil(cycles, q_e);
    const Joint before = test.torque;
    start_test(robot, settings, limits, q_e, known, test, prior.weighing());
    Joint torque = test.torque;
    for (int i = 0; i < n; ++i) {
      CHECK(std::fabs(torque[i]) <= limits.torque[i]);
      CHECK(std::fabs(torque[i] - before[i]) <= limits.slew[i] * limits.period * (1 + 1e-9));
      CHECK(torque[i] == 0 || test.state > StartState::explain);
      largest = std::max(largest, std::fabs(torque[i]));
    }
    if (wrong.kind == StartFinding::wrong_way) torque[wrong.a] *= -1;
    if (wrong.kind == StartFinding::no_torque) std::swap(torque[wrong.a], torque[wrong.b]);
    std::uint32_t brakes = test.brakes;
    if (wrong.kind == StartFinding::no_motion) brakes |= bit(wrong.a);
    if (wrong.kind == StartFinding::brake_slips && test.state == StartState::open)
      brakes &= ~bit(wrong.a);
    plant.work_brakes(brakes, limits.period, real.opens, real.closes);
    CHECK(bool(plant.advance(torque, limits.period, 2)));
    double sum = 0;
    for (int j = 0; j < positions_of(K); ++j) sum += std::pow(plant.pose().D[j] - started.D[j], 2);
    moved = std::max(moved, std::sqrt(sum));
    const bool over = test.state >= StartState::passed;
    if (over &&
        std::all_of(test.torque.begin(), test.torque.end(), [](double t) { return t == 0; }))
      break;
  }
  seconds = cycles * limits.period;
  CHECK(test.state >= StartState::passed && test.brakes == bit(n) - 1);
}

bool StartBench::found(StartFinding finding, int part) const {
  return test.state == StartState::failed && test.finding == finding && test.part == part;
}

bool StartBench::named(const Miswiring& wrong) const {
  const bool pair = wrong.kind != StartFinding::exchanged || test.other == wrong.b;
  return found(wrong.kind, wrong.a) && pair;
}

bool StartBench::listed(const Miswiring& wrong) const {
  const std::uint32_t all = bit(wrong.a) | (wrong.b < 0 ? 0 : bit(wrong.b));
  return test.finding == StartFinding::inconsistent && (test.candidates & all) == all;
}

Robot h4_with(int sensors) {
  Robot robot = limited_robot(h4());
  const double count = 2 * std::numbers::pi / 14400;
  robot.sensor[0].step = count / 4;  // geared
  robot.r = sensors;
  robot.sensor[1] = {};
  robot.sensor[1].kind = SensorKind::rod_in_plane;
  robot.sensor[1].chain = 0;
  robot.sensor[1].step = count;
  CHECK(bool(finish(robot)));
  CHECK(bool(finish_full(robot)));
  return robot;
}
}  // namespace mechanisms
