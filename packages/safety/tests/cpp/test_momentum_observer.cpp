// External forces observed from torques and motor readings, and their causes.
#include "controllers.hpp"
#include "safety/momentum_defaults.hpp"
#include "simulation/effects.hpp"

using namespace mechanisms;

namespace {
constexpr double kPeriod = 1e-3;

/// A robot that moves about home under the joint law, and the observer of its momentum.
class Scene {
 public:
  Scene(const Mechanism& mechanism, double count, std::uint64_t seed)
      : n(dof(mechanism.robot.mobility)),
        motors(mechanism.robot.motors),
        robot(mechanism.robot),
        truth(counted(mechanism.robot, count)),
        box_(mechanism.box),
        plant(truth, {}, to_pose(robot.mobility, robot.home), seed),
        control_settings(settings_for(robot, Law::joint)) {
    check::Random random(seed);
    for (int i = 0; i < n; ++i) phase_[i] = 3 * random();
    for (int i = 0; i < motors; ++i) {
      unit[i] = 5e-5 * control_settings.kp[i];
      // Counts through the filter, of the motor's inertia: kp is placed for 100 rad/s.
      const double inertia = control_settings.kp[i] / 1e4;
      settings.sigma[i] = std::hypot(unit[i], inertia * 60 * 60 * count);
    }
    CHECK(plant.rest());
  }
  static Robot counted(Robot robot, double count) {
    for (int i = 0; i < robot.motors; ++i) robot.chain[i].encoder_step = count;
    return robot;
  }
  Setpoint at(double t) const {
    Setpoint setpoint;
    const double rise = std::clamp(std::min(t, until - t) / 0.2, 0.0, 1.0);
    const double s = rise * rise * (3 - 2 * rise);
    setpoint.x = robot.home;
    for (int i = 0; i < n; ++i)
      setpoint.x[i] += 0.3 * s * box_[i] * std::sin((8 + 2 * i) * t + phase_[i] * s) * (t > 0);
    return setpoint;
  }
  /// One period. @param seen  called after it
  void cycle() {
    const double h = 1e-4;
    Setpoint setpoint = at(time);
    const Coordinates before = at(time - h).x, after = at(time + h).x;
    for (int i = 0; i < n; ++i) {
      setpoint.rate[i] = (after[i] - before[i]) / (2 * h);
      setpoint.acceleration[i] = (after[i] - 2 * setpoint.x[i] + before[i]) / (h * h);
    }
    Extended q_e{};
    CHECK(plant.measure(q_e));
    Pose pose = plant.pose();
    CHECK(fkm(robot, motors_of(robot, q_e), pose).status == Status::ok);
    if (state.started) sample_momentum(robot, settings, pose, state.torque, observer);
    for (int step = 0; step < kMomentumSteps; ++step)
      CHECK(observe_momentum(robot, settings, observer));
    CHECK(control(robot, control_settings, setpoint, q_e, state));
    add_payload_torque(robot, settings, setpoint, observer, state.torque);
    CHECK(plant.advance(state.torque, kPeriod, 2));
    time += kPeriod;
  }
  void run(double seconds) {
    for (int k = 0; k < seconds / kPeriod; ++k) cycle();
  }

  int n, motors;
  Robot robot, truth;
  Coordinates box_;
  Plant plant;
  ControlSettings control_settings;
  ControlState state;
  MomentumSettings settings;
  MomentumObserver observer;
  double time = 0, until = INFINITY;  ///< it rests at home
  Joint unit{};                       ///< a motor's assumed friction, N·m or N

 private:
  Joint phase_{};
};
}  // namespace

TEST_EACH(for_each,
          "without a disturbance an exact model leaves no residual, however the robot moves") {
  Scene scene(mechanism, 0, 1);
  double most = 0, torque = 0;
  for (int k = 0; k < 1000; ++k) {
    scene.cycle();
    for (int i = 0; i < scene.n; ++i) {
      most = std::max(most, std::fabs(scene.observer.residual[i]));
      torque = std::max(torque, std::fabs(scene.state.torque[i]));
    }
  }
  CHECK(most < 5e-3 * torque);  // torques are held for a period
  CHECK(scene.observer.disturbance == Disturbance::none);
}

TEST_EACH(for_each, "the residual is the external force, through the observer's filter") {
  Scene scene(mechanism, 0, 2);
  scene.run(0.3);
  Event push{.kind = Disturbance::contact};
  for (int i = 0; i < scene.n; ++i) push.force[i] = i < 2 ? 20 - 30.0 * i : 0;
  scene.plant.disturb(push);
  scene.run(0.3);
  for (int i = 0; i < scene.n; ++i) CHECK(std::fabs(scene.observer.force[i] - push.force[i]) < 1.5);
  CHECK(scene.observer.disturbance == Disturbance::contact);
  scene.plant.disturb(push, -1);
  scene.run(0.4);
  CHECK(scene.observer.disturbance == Disturbance::none);
}

TEST_EACH(for_each, "a payload is identified to a tenth or 50 g within half a second of motion") {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    Scene scene(mechanism, 1e-5, seed);
    scene.run(0.3);
    const double mass = 2 + 0.1 * seed;
    scene.plant.disturb({.kind = Disturbance::payload, .size = mass});
    scene.run(0.5);
    CHECK(scene.observer.disturbance == Disturbance::payload);
    CHECK(std::fabs(scene.observer.size - mass) < std::max(0.1 * mass, 0.05));
    CHECK(std::fabs(scene.observer.size - mass) < 4 * scene.observer.sigma);
  }
}

TEST_EACH(for_each_square, "friction is attributed to its motor") {
  for (int motor = 0; motor < motors; ++motor) {
    Scene scene(mechanism, 1e-5, 5);
    scene.run(0.3);
    const double size = 40 * scene.unit[motor];
    scene.plant.disturb({.kind = Disturbance::friction, .motor = motor, .size = size});
    scene.run(0.5);
    CHECK(scene.observer.disturbance == Disturbance::friction);
    CHECK(scene.observer.motor == motor);
    CHECK(std::fabs(scene.observer.size / size - 1) < 0.2);
  }
}

TEST_EACH(for_each, "the same friction of all motors is friction of all, not a contact") {
  Scene scene(mechanism, 1e-5, 5);
  scene.run(0.3);
  const double size = 40 * scene.unit[0];
  for (int motor = 0; motor < motors; ++motor)
    scene.plant.disturb({.kind = Disturbance::friction, .motor = motor, .size = size});
  scene.run(0.5);
  CHECK(scene.observer.disturbance == Disturbance::friction);
  CHECK(scene.observer.motor == -1 || n == 1);
  CHECK(std::fabs(scene.observer.size / size - 1) < 0.3);
}

TEST_EACH(for_each_square, "friction of motors that have come to rest is not a contact") {
  Scene scene(mechanism, 1e-5, 5);
  scene.until = 0.8;
  for (int motor = 0; motor < scene.n; ++motor)
    scene.plant.disturb(
        {.kind = Disturbance::friction, .motor = motor, .size = 40 * scene.unit[0]});
  scene.run(0.6);
  CHECK(scene.observer.disturbance == Disturbance::friction);
  for (int k = 0; k < 1500; ++k) {
    scene.cycle();
    CHECK(scene.observer.disturbance != Disturbance::contact);
  }
}

TEST_EACH(for_each, "the assumed friction of all motors and counts are no disturbance") {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    Scene scene(mechanism, 1e-5, seed);
    for (int i = 0; i < scene.n; ++i)
      scene.plant.disturb({.kind = Disturbance::friction, .motor = i, .size = scene.unit[i]});
    for (int k = 0; k < 1000; ++k) {
      scene.cycle();
      CHECK(scene.observer.disturbance == Disturbance::none);
    }
  }
}

TEST_EACH(for_each,
          "default settings follow torque limits, gains and counts; without a torque limit: none") {
  Robot robot = mechanism.robot;
  ControlSettings gains = settings_for(robot, Law::joint);
  gains.period = 1.5e-3;
  for (int i = 0; i < robot.motors; ++i) {
    robot.chain[i].torque_limit = 0.01 * std::fabs(gains.kp[i]);
    robot.chain[i].encoder_step = 0;
  }
  MomentumSettings settings;
  CHECK(default_momentum(robot, gains, settings));
  CHECK_NEAR(settings.period, 4.5e-3, 1e-12);  // whole control periods, nearest to 4 ms
  for (int i = 0; i < robot.motors; ++i) {
    CHECK_NEAR(settings.sigma[i], 1e-4 * std::fabs(gains.kp[i]), 1e-9 * std::fabs(gains.kp[i]));
    CHECK_NEAR(settings.give[i] * std::fabs(gains.kp[i]), 1, 1e-12);
  }
  robot.chain[0].encoder_step = 1;
  CHECK(default_momentum(robot, gains, settings) &&
        settings.sigma[0] > 2e-4 * std::fabs(gains.kp[0]));
  robot.chain[0].torque_limit = 0;
  CHECK(default_momentum(robot, gains, settings).status == Status::no_such_value);
  CHECK(settings.period == 0);
}
