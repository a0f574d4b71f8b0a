// Static equilibrium of a robot that is not its model, under each law.
#include <limits>

#include "controllers.hpp"
#include "moves.hpp"
#include "simulation/statics.hpp"

using namespace mechanisms;

namespace {

/// The robot as built: some rods and arms longer or shorter than drawn.
Robot built(const Robot& nominal, check::Random& random) {
  Robot truth = nominal;
  for (int i = 0; i < nominal.motors; ++i) {
    truth.chain[i].rod += 1e-3 * random();
    truth.chain[i].arm += 3e-4 * random();
    truth.chain[i].encoder_offset += 1e-3 * random();
  }
  return truth;
}

}  // namespace

TEST_EACH(for_each,
          "settle() foretells where the simulation comes to rest, with and without gravity") {
  check::Random random(63);
  for (const bool gravity : {false, true}) {
    Robot nominal = robot;
    if (!gravity) nominal.gravity = Vec3::Zero();
    const Robot truth = built(nominal, random);
    const Coordinates to = any_x(random, 0.5);
    for (const Law law : kLaws) {
      const Gains gains = law == Law::joint ? Gains::diagonal : Gains::inertia;
      const StaticsSettings settings{settings_for(nominal, law, gains), gravity};
      Coordinates start{}, end{};
      Prior prior(nominal);
      CHECK(settle(nominal, truth, settings, nominal.home, start, prior.weighing()));
      CHECK(settle(nominal, truth, settings, to, end, prior.weighing()));
      Sample last{};
      CHECK(run_move(Loop(nominal, truth, settings.control, start, 0, Extras{prior.weighing()}), K,
                     nominal.home, to, 0.2, 0.6, [&](const Sample& sample) { last = sample; }));
      // Of redundant motors' torques that only stress the nominal robot, the true one's other K
      // turns a little into force.
      CHECK_NEAR(distance(K, to_pose(K, last.x), to_pose(K, end)), 0, motors > n ? 1e-8 : 1e-9);
      CHECK(distance(K, to_pose(K, end), to_pose(K, to)) > 1e-5);  // the errors do show
    }
  }
}

TEST_EACH(
    for_each,
    "an error of one reading leaks into the pose at rest as leakage() says, under every law") {
  Robot robot = mechanism.robot;
  robot.r = 2;
  check::Random random(64);
  const Coordinates x = any_x(random);
  Prior prior(robot);
  for (const Law law : kLaws) {
    PoseColumns leak;
    CHECK(leakage(robot, law, x, leak, prior.weighing()));
    for (int c = 0; c < readings(robot); ++c) {
      Pose rest[2];
      for (const double side : {-1.0, 1.0}) {
        Robot read = robot;  // reading = position - offset
        (c < motors ? read.chain[c].encoder_offset : read.sensor[c - motors].offset) -= side * 1e-5;
        Coordinates end{};
        CHECK(settle(robot, read, {settings_for(robot, law), false}, x, end, prior.weighing()));
        rest[side > 0] = to_pose(K, end);
      }
      const Coordinates change = difference(K, rest[1], rest[0]);
      for (int i = 0; i < n; ++i) CHECK_NEAR(leak[i][c], change[i] / 2e-5, 1e-6);
    }
  }
}

TEST("a robot rests under its weight also where gravity holds it more stiffly than a soft PD") {
  constexpr Mobility K = Mobility::schoenflies;
  const Robot robot = h4().robot;
  check::Random random(89);
  for (const Gains gains : {Gains::diagonal, Gains::inertia}) {
    ControlSettings settings;
    settings.gains = gains;
    CHECK(place_poles(robot, robot.home, 8, 1, settings));
    settings.feed_forward = FeedForward::gravity;
    const Robot truth = built(robot, random);
    Coordinates x{};
    Joint load{};
    CHECK(settle(robot, truth, {settings, true}, robot.home, x));
    Extended q_e{};
    CHECK(extended(Level::ideal, truth, to_pose(K, x), q_e));
    Setpoint at_home;
    at_home.x = robot.home;
    ControlState state;
    CHECK(control(robot, settings, at_home, q_e, state));
    CHECK(inverse_dynamics(truth, to_pose(K, x), Coordinates{}, Coordinates{}, load));
    for (int i = 0; i < 4; ++i) CHECK_NEAR(state.torque[i], load[i], 1e-9);
  }
}

TEST("settle() never calls a NaN settled") {
  const Robot robot = h4().robot;
  for (const Gains gains : {Gains::diagonal, Gains::inertia}) {
    StaticsSettings settings{settings_for(robot, Law::joint, gains), true};
    for (const double gain : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
      settings.control.kp.fill(gain);
      Coordinates x{};
      CHECK(!settle(robot, robot, settings, robot.home, x));
    }
  }
}
