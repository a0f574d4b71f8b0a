#include "mechanisms.hpp"

namespace mechanisms {
Vec3 polar(double radius, double angle, double z) {
  return {radius * std::cos(degrees(angle)), radius * std::sin(degrees(angle)), z};
}

Prior::Prior(const Robot& robot) {
  std::vector<double> sigma;
  for (int i = 0; i < robot.motors; ++i)
    for (int k = 0; k < static_cast<int>(ChainParameter::rod_difference); ++k) {
      column_.push_back(chain_column(i) + k);
      sigma.push_back(1e-4 * (1 + (3 * i + k) % 5));
    }
  for (int k = 0; k < robot.r; ++k) {
    column_.push_back(sensor_column(robot, k));
    sigma.push_back(2e-4);
  }
  const int p = static_cast<int>(sigma.size());
  root_.resize(p * p);
  for (int k = 0; k < p; ++k) root_[k * p + k] = sigma[k];
  known_ = {p, column_.data(), root_.data(), {}};
  known_.sigma.fill(1e-5);
  work_.resize(estimate_work(robot, p));
}

OnlineCalibrator Prior::learner(const Robot& robot) {
  filter_.resize(online_memory(robot, known_.count));
  drift_.assign(2 * known_.count, 1e-7);
  OnlineCalibrator learner;
  if (!start(robot, known_, filter_.data(), learner))
    std::printf("a robot that is not finished learns\n");
  learner.settings.changes.drifts = 2, learner.settings.changes.drift = drift_.data();
  return learner;
}

OnlineCalibrator Prior::follower(const Robot& robot) {
  OnlineCalibrator learner = this->learner(robot);
  const int p = known_.count;
  step_.assign(p * p, 0);
  end_.resize(p);
  odds_.assign(p, -9);
  for (int k = 0; k < p; ++k) {
    step_[k * p + k] = 50 * known_.root[k * p + k];
    end_[k] = k + 1;
  }
  const ChangeSettings changes{p, p, 2, -1, step_.data(), end_.data(), odds_.data(), drift_.data()};
  memory_.resize(follow_memory(learner, changes));
  follow(changes, memory_.data(), window_, learner);
  return learner;
}

Sensor telemeter(const Vec3& origin, const Vec3& direction, const Vec3& target,
                 const Vec3& normal) {
  Sensor sensor;
  sensor.kind = SensorKind::plane_distance;
  sensor.origin = origin;
  sensor.direction = direction.normalized();
  sensor.target = target;
  sensor.normal = normal.normalized();
  return sensor;
}

void add_body(Robot& robot, double mass, const Vec3& pivot, const Vec3& anchor,
              const Vec3& inertia) {
  Body& body = robot.body[robot.bodies++];
  body.mass = mass;
  body.pivot = pivot;
  body.anchor = anchor;
  for (int i = 0; i < 3; ++i) body.inertia(i, i) = inertia[i];
}

void set_masses(Chain& chain, double drive, double arm, double rod) {
  chain.drive_inertia = drive;
  chain.arm_mass = arm;
  chain.rod_mass = rod;
}

void set_pair(Chain& chain, int bar) {
  chain.bar = bar;
  chain.rod_spacing = 0.08;
  chain.pair_axis = chain.axis.cross(chain.zero);  // of a carriage: across rail and rod
  chain.pair_drawn = pair_direction(chain);
}

namespace {
/// A robot whose chains and bodies these functions fill in, with the sensors of all.
Mechanism made(const char* name, Mobility mobility, const Coordinates& box, const Coordinates& home,
               int motors, const std::function<void(int, Chain&)>& chain,
               const std::function<void(Robot&)>& bodies) {
  Mechanism mechanism{name, {}, box};
  Robot& robot = mechanism.robot;
  robot.mobility = mobility;
  robot.home = home;
  robot.motors = motors;
  for (int i = 0; i < motors; ++i) chain(i, robot.chain[i]);
  bodies(robot);
  robot.chains = robot.motors;
  robot.r = 1;
  if (robot.mobility == Mobility::planar_translation || robot.mobility == Mobility::planar) {
    robot.gravity = Vec3(0, -9.81, 0);  // standing upright, so that weight matters
    robot.sensor[0] = robot.sensor[1] =
        telemeter({-0.6, 0.05, 0}, {1, 0.1, 0}, {0.03, 0.01, 0}, {1, -0.2, 0});
    if (robot.mobility == Mobility::planar_translation)
      robot.sensor[1] = telemeter({0.1, -0.5, 0}, {0.1, 1, 0}, {0.03, 0.01, 0}, {0.3, 1, 0});
    else
      robot.sensor[0] = Sensor{};
  } else {
    robot.sensor[0] = telemeter({0.02, 0.01, 0}, {0.1, 0, -1}, {0.03, 0.01, 0.02}, {0.05, 0.1, 1});
    robot.sensor[1] = telemeter({-0.6, 0.05, -0.4}, {1, 0.1, 0.1}, {0.03, 0.01, 0}, {1, -0.2, 0.1});
    if (robot.mobility == Mobility::schoenflies) robot.sensor[0] = Sensor{};
  }
  Outcome outcome = finish(robot);
  if (outcome) outcome = finish_full(robot);
  if (!outcome) std::printf("%s: home is %s\n", mechanism.name, describe(outcome.status));
  return mechanism;
}
}  // namespace

Mechanism h4() {
  constexpr double l = 0.26, L = 0.48, R = 0.14, d = 0.06, h = 0.06;
  const Vec3 bases[]{{h + R, d, 0}, {-(h + R), d, 0}, {-h, -(d + R), 0}, {h, -(d + R), 0}};
  const Vec3 axes[]{{0, 1, 0}, {0, -1, 0}, {1, 0, 0}, {1, 0, 0}};
  const Vec3 zeros[]{{1, 0, 0}, {-1, 0, 0}, {0, -1, 0}, {0, -1, 0}};
  return made(
      "H4", Mobility::schoenflies, {0.1, 0.1, 0.05, std::numbers::pi / 6}, {0, 0, -0.4, 0}, 4,
      [&](int i, Chain& chain) {
        chain.base = bases[i];
        chain.axis = axes[i];
        chain.zero = zeros[i];
        chain.arm = l;
        chain.rod = L;
        chain.pivot = Vec3(i == 0 || i == 3 ? h : -h, 0, 0);
        chain.anchor = Vec3(0, i < 2 ? d : -d, 0);
        set_pair(chain, i == 0 || i == 3 ? 0 : 1);
        set_masses(chain, 0.017, 0.30, 0.10);
      },
      [](Robot& robot) {
        add_body(robot, 0.60, Vec3::Zero(), Vec3::Zero(), {0, 0, 0.00156});
        add_body(robot, 0.20, Vec3(h, 0, 0));
        add_body(robot, 0.20, Vec3(-h, 0, 0));
      });
}

Mechanism five_bar() {
  const Vec3 bases[]{{-0.15, 0, 0}, {0.17, 0.01, 0}};
  return made(
      "5-bar", Mobility::planar_translation, {0.06, 0.05}, {0.01, 0.33}, 2,
      [&](int i, Chain& chain) {
        chain.base = bases[i];
        chain.axis = Vec3::UnitZ();
        chain.zero = Vec3::UnitX();
        chain.arm = 0.20 + 0.01 * i;
        chain.rod = 0.30 - 0.01 * i;
        chain.working_mode = i == 0 ? 1 : -1;
        chain.encoder_offset = 0.1 - 0.3 * i;
        set_masses(chain, 0.002, 0.3, 0.2);
      },
      [](Robot& robot) { add_body(robot, 0.5, Vec3::Zero()); });
}

Mechanism planar(const char* name, Actuator actuator, int motors) {
  const bool legs = actuator == Actuator::telescopic, four = motors == 4;
  return made(
      name, Mobility::planar, {0.04, 0.04, 0.2}, {0.01, 0.02, 0.1}, motors,
      [&](int i, Chain& chain) {
        chain.actuator = actuator;
        chain.base = polar(0.40 + 0.01 * i, four ? 45 + 90 * i : 90 + 120 * i);
        chain.axis = Vec3::UnitZ();
        chain.zero = Vec3::UnitX();
        chain.arm = 0.20 + 0.005 * i;
        chain.rod = 0.26 - 0.004 * i;
        chain.pivot = polar(0.12 + 0.01 * i, four   ? 65 + 92 * i
                                             : legs ? 190 + 115 * i
                                                    : 90 + 120 * i);
        if (four) chain.working_mode = 1;
        set_masses(chain, legs ? 0.5 : 0.002, 0.3, 0.2);
      },
      [](Robot& robot) { add_body(robot, 0.8, Vec3(0.01, 0.02, 0), Vec3::Zero(), {0, 0, 0.004}); });
}

Mechanism four_rrr() { return planar("4-RRR", Actuator::revolute, 4); }

Mechanism eight_cables() {
  return made(
      "8 cables", Mobility::spatial, {0.1, 0.1, 0.1, 0.15, 0.15, 0.15},
      {0.01, -0.02, 0.03, 0.03, -0.02, 0.05}, 8,
      [&](int i, Chain& chain) {
        chain.actuator = Actuator::telescopic;
        const bool upper = i < 4;
        const double angle = 45 + 90 * (i % 4),
                     turn = i % 2 == 0 ? 1 : -1;  // cables cross in pairs
        chain.base = polar(0.75 + 0.005 * i, angle + i, upper ? 0.5 : -0.5);
        chain.pivot = polar(0.1 + 0.002 * i, angle + (upper ? 60 : -45) * turn, upper ? -0.1 : 0.1);
        set_masses(chain, 0.5, 0, 0);
      },
      [](Robot& robot) {
        add_body(robot, 5, Vec3(0.01, 0.02, -0.03), Vec3::Zero(), {0.1, 0.12, 0.14});
      });
}

Robot meeting_legs() {
  Robot robot = planar("3-RPR", Actuator::telescopic).robot;
  for (int i = 0; i < 3; ++i) {
    robot.chain[i].base = polar(0.4, 90 + 120 * i);
    robot.chain[i].pivot = polar(0.1, 90 + 120 * i);
  }
  return robot;
}

Mechanism delta() {
  return made(
      "Delta", Mobility::translation, {0.12, 0.12, 0.08}, {0.02, 0.01, -0.6}, 3,
      [](int i, Chain& chain) {
        chain.zero = polar(1, 119 * i);
        chain.axis = Vec3::UnitZ().cross(chain.zero);
        chain.base = 0.2 * chain.zero + Vec3(0, 0, 0.005 * i);
        chain.arm = 0.3 + 0.004 * i;
        chain.rod = 0.7 - 0.005 * i;
        chain.pivot = polar(0.05, 120 * i);
        set_pair(chain);
        set_masses(chain, 0.02, 0.4, 0.15);
      },
      [](Robot& robot) { add_body(robot, 1, {0, 0, -0.02}); });
}

Mechanism linear_delta() {
  return made(
      "linear Delta", Mobility::translation, {0.1, 0.1, 0.1}, {0.02, -0.01, -0.5}, 3,
      [&](int i, Chain& chain) {
        chain.actuator = Actuator::prismatic;
        chain.base = polar(0.35 + 0.01 * i, 30 + 120 * i);
        chain.axis =
            (Vec3::UnitZ() + polar(0.1, 20 + 100 * i)).normalized();  // rails lean a little
        chain.zero = chain.axis.cross(polar(1, 120 + 120 * i)).normalized();
        chain.rod = 0.6 - 0.01 * i;
        chain.working_mode = 1;  // carriages above the nacelle
        chain.pivot = polar(0.06, 30 + 120 * i);
        set_pair(chain);
        chain.encoder_offset = 0.02 * i;
        set_masses(chain, 0.3, 0.5, 0.2);
      },
      [](Robot& robot) { add_body(robot, 1.5, {0, 0, -0.02}); });
}

Mechanism par4() {
  return made(
      "Par4", Mobility::schoenflies, {0.12, 0.12, 0.06, 0.4}, {0.02, -0.01, -0.65, 0.1}, 4,
      [](int i, Chain& chain) {
        chain.zero = polar(1, 45 + 90 * i + 2 * (i % 3));
        chain.axis = Vec3::UnitZ().cross(chain.zero);
        chain.base = 0.275 * chain.zero;
        chain.arm = 0.375 + 0.002 * i;
        chain.rod = 0.8 + 0.003 * i;
        chain.pivot = Vec3(i == 0 || i == 3 ? 0.08 : -0.08, 0, 0.004 * i);
        chain.anchor = Vec3(0, i < 2 ? 0.06 : -0.06, 0);
        set_pair(chain, i == 0 || i == 3 ? 0 : 1);
        set_masses(chain, 0.02, 0.4, 0.2);
      },
      [](Robot& robot) {
        robot.bar_joint = BarJoint::four_bar;
        add_body(robot, 0.7, Vec3(0.01, 0, 0), Vec3::Zero(), {0, 0, 0.004});
        add_body(robot, 0.25, Vec3(0.08, 0, 0), Vec3(0, 0.01, 0));
        add_body(robot, 0.25, Vec3(-0.08, 0, 0));
      });
}

Mechanism hexapod(const char* name, Actuator actuator) {
  constexpr double base[]{-15, 15, 105, 135, 225, 255}, nacelle[]{-45, 45, 75, 165, 195, 285};
  return made(
      name, Mobility::spatial, {0.06, 0.06, 0.06, 0.15, 0.15, 0.15},
      {0.01, -0.02, -0.55, 0.03, -0.02, 0.05}, 6,
      [&](int i, Chain& chain) {
        chain.actuator = actuator;
        chain.base = polar(0.35 + 0.004 * i, base[i] + i, 0.003 * i);
        chain.zero = polar(1, base[i] + i);
        chain.axis = Vec3::UnitZ().cross(chain.zero);
        chain.arm = 0.25 + 0.002 * i;
        chain.rod = 0.6 - 0.003 * i;
        chain.pivot = polar(0.18 + 0.003 * i, nacelle[i] - 2 * i, 0.01 + 0.002 * i);
        set_masses(chain, actuator == Actuator::telescopic ? 0.8 : 0.02, 0.4, 0.25);
      },
      [](Robot& robot) {
        add_body(robot, 2, Vec3(0.01, 0.02, -0.03), Vec3::Zero(), {0.02, 0.025, 0.03});
        robot.body[0].inertia(0, 1) = robot.body[0].inertia(1, 0) = 0.002;
      });
}

Mechanism hexaglide() {
  constexpr double y[]{-0.32, -0.30, 0.02, -0.02, 0.30, 0.33};
  const Vec3 pivots[]{{-0.15, -0.15, 0},   {-0.06, -0.09, 0.01}, {0.09, 0.06, 0},
                      {0.15, -0.06, 0.01}, {-0.09, 0.06, 0},     {0.09, 0.12, 0.01}};
  return made(
      "Hexaglide", Mobility::spatial, {0.08, 0.06, 0.06, 0.12, 0.12, 0.12},
      {0.02, 0.01, -0.45, 0.02, -0.03, 0.04}, 6,
      [&](int i, Chain& chain) {
        chain.actuator = Actuator::prismatic;
        chain.base = Vec3(0.01 * i, y[i], 0);
        chain.axis = (Vec3::UnitX() + Vec3(0, 0.01 * i, -0.01)).normalized();
        chain.rod = 0.7 - 0.004 * i;
        chain.working_mode = i % 2 == 0 ? 1 : -1;
        chain.pivot = pivots[i];
        set_masses(chain, 0.3, 0.8, 0.25);
      },
      [](Robot& robot) {
        add_body(robot, 2, Vec3(0.01, 0.02, -0.03), Vec3::Zero(), {0.02, 0.025, 0.03});
      });
}

void for_all(const std::vector<Mechanism>& list, const std::function<void(const Mechanism&)>& f) {
  for (const Mechanism& mechanism : list) {
    check::state().scene = mechanism.name;
    f(mechanism);
  }
}

void for_each(const std::function<void(const Mechanism&)>& f) {
  static const std::vector<Mechanism> all{h4(),
                                          five_bar(),
                                          planar("3-RRR", Actuator::revolute),
                                          planar("3-RPR", Actuator::telescopic),
                                          delta(),
                                          linear_delta(),
                                          par4(),
                                          hexapod("6-UPS", Actuator::telescopic),
                                          hexapod("Hexa", Actuator::revolute),
                                          hexaglide(),
                                          four_rrr(),
                                          eight_cables()};
  for_all(all, f);
}

void for_each_square(const std::function<void(const Mechanism&)>& f) {
  for_each([&](const Mechanism& mechanism) {
    if (!overdriven(mechanism.robot)) f(mechanism);
  });
}

void for_each_overdriven(const std::function<void(const Mechanism&)>& f) {
  for_all({four_rrr(), eight_cables()}, f);
}

void for_each_model(const std::function<void(const Mechanism&, Level)>& f) {
  for_each([&](const Mechanism& mechanism) {
    f(mechanism, Level::ideal);
    if (mechanism.robot.full.kind == FullKind::exists) f(mechanism, Level::full);
  });
}

Coordinates random_pose(const Mechanism& mechanism, check::Random& random, double part) {
  Coordinates x = mechanism.robot.home;
  for (int i = 0; i < dof(mechanism.robot.mobility); ++i)
    x[i] += part * mechanism.box[i] * random();
  return x;
}

Pose nearby(Mobility K, const Pose& pose, check::Random& random, double size) {
  Coordinates step{};
  for (int i = 0; i < dof(K); ++i) step[i] = random() < 0 ? -size : size;
  return moved(K, pose, step);
}

Extended readings_at(const Robot& robot, const Pose& pose) {
  Extended q_e{};
  CHECK(extended(Level::ideal, robot, pose, q_e));
  return q_e;
}

Extended readings_at(const Robot& robot, const Coordinates& x) {
  return readings_at(robot, to_pose(robot.mobility, x));
}

RandomNumbers::operator Joint() const {
  Joint all{};
  std::copy(values.begin(), values.end(), all.begin());
  return all;
}
RandomNumbers random_joint(check::Random& random, double size) {
  RandomNumbers drawn;
  for (double& value : drawn.values) value = size * random();
  return drawn;
}

double distance(Mobility K, const Pose& a, const Pose& b) {
  const Coordinates step = difference(K, a, b);
  double largest = 0;
  for (int i = 0; i < dof(K); ++i) {
    if (std::isnan(step[i])) return INFINITY;
    largest = std::max(largest, std::fabs(step[i]));
  }
  return largest;
}
}  // namespace mechanisms
