// Answers of the full level. A Jacobian that is its derivative, readings that follow, whether
// it exists at all, and a status where it cannot answer.
#include "derivative.hpp"
#include "full_robots.hpp"
#include "mechanism/levels.hpp"

using namespace mechanisms;

TEST_EACH(
    for_each_full,
    "J at the full level is the derivative of its forward model, readings follow the motors") {
  check::Random random(95);
  for (int k = 0; k < 30; ++k) {
    Robot robot = with_axis_errors(mechanism.robot, random);
    robot.r = 2;
    if (K == kH4) {  // both kinds of angle sensor, and the telemeter
      robot.r = 3;
      robot.sensor[2] = robot.sensor[1];
      robot.sensor[1] = robot.sensor[0];
      robot.sensor[1].bar = k % 2;
      robot.sensor[1].gain = 1.1;
    }
    const Coordinates x = any_x(random);
    FullClosure closure;
    JointMatrix of_closure, J;
    CHECK(ikm(robot, to_pose(K, x), closure));
    CHECK(jacobian(robot, closure, of_closure) && jacobian(Level::full, robot, x, J));
    const engine::Mechanism& rods = closure.built.mechanism;
    const engine::Freedoms unknown = engine::forward(rods);
    Matrix<kMaxUnknowns, kMaxUnknowns> rates;
    CHECK(engine::follow(rods, closure.at, unknown, engine::motors(rods), rates));
    const auto moved_to = [&](int motor, double h) {
      Joint q = closure.q();
      q[motor] += h;
      FullPose pose = closure.pose;
      FullClosure there;
      CHECK(fkm(robot, q, pose, there));
      return there;
    };
    for (int m = 0; m < n; ++m) {
      for (int i = 0; i < n; ++i) {
        CHECK(J[i][m] == of_closure[i][m]);
        const double slope = derivative(
            [&](double h) { return difference(K, moved_to(m, h).pose, closure.pose)[i]; });
        CHECK_NEAR(J[i][m], slope, 1e-7 * (1 + std::fabs(slope)));
      }
      for (int s = 0; s < robot.r; ++s) {
        const Sensor& sensor = robot.sensor[s];
        const engine::Row row =
            sense(robot, closure.built, closure.at, closure.pose.theta, sensor).row;
        double chained = sensor.gain * row[m];
        for (int i = 0; i < unknown.count; ++i)
          chained += sensor.gain * row[unknown.index[i]] * rates[i][m];
        const double slope = derivative([&](double h) {
          const FullClosure there = moved_to(m, h);
          Extended q_e;
          CHECK(read(robot, there.built, there.at, there.pose.theta, q_e));
          return q_e[n + s];
        });
        CHECK_NEAR(chained, slope, 1e-7 * (1 + std::fabs(slope)));
      }
    }
  }
}

TEST("whether the full level exists follows from rods, freedoms and rank") {
  const auto level = [](Robot robot) {
    CHECK(finish_full(robot));
    return robot.full;
  };
  for (const Mechanism& mechanism : with_pairs()) {
    const FullLevel full = level(mechanism.robot);
    CHECK(full.kind == FullKind::exists && full.rods == full.unknowns && full.sign != 0);
  }
  Robot robot = par4().robot;  // bars joined by a rigid four-bar: 6 and 1 freedoms
  FullLevel full = level(robot);
  CHECK(full.kind == FullKind::elastic && full.rods == 8 && full.unknowns == 7);
  CHECK(full.excess == 1 && full.sign == 0);
  for (Chain& chain : robot.chain) chain.bar = -1;  // a rigid nacelle
  full = level(robot);
  CHECK(full.kind == FullKind::overconstrained && full.excess == 2);

  robot = h4().robot;  // chains 1 and 2 on one bar leave its tilt free
  for (int i = 0; i < 4; ++i) {
    Chain& chain = robot.chain[i];
    chain.bar = i < 2 ? 0 : 1;
    chain.pivot = Vec3(0, i < 2 ? 0.06 : -0.06, 0);
    chain.anchor = Vec3(i == 0 || i == 3 ? 0.06 : -0.06, 0, 0);
  }
  full = level(robot);
  CHECK(full.kind == FullKind::loose && full.excess >= 1);
  robot = linear_delta().robot;  // pairs one above the other on upright rails: free about z
  for (int i = 0; i < 3; ++i) {
    Chain& chain = robot.chain[i];
    chain.axis = Vec3::UnitZ();
    chain.pair_axis = chain.pair_drawn = Vec3::UnitZ();
  }
  full = level(robot);
  CHECK(full.kind == FullKind::loose && full.excess >= 1);
  robot = h4().robot;
  robot.chain[2].rod_spacing = 0;
  CHECK(level(robot).kind == FullKind::undescribed);
}

TEST("a robot without a full level says so, whatever it is asked") {
  Robot robot = par4().robot;
  for (Chain& chain : robot.chain) chain.bar = -1;  // two rods too many
  CHECK(finish_full(robot));
  Coordinates x = robot.home, turns{};
  Joint q{};
  Extended q_e{};
  JointMatrix J{};
  CHECK(ikm(Level::full, robot, x, q).status == Status::no_full_level);
  CHECK(extended(Level::full, robot, to_pose(robot.mobility, x), q_e).status ==
        Status::no_full_level);
  CHECK(jacobian(Level::full, robot, x, J).status == Status::no_full_level);
  CHECK(parasitic(robot, x, turns).status == Status::no_full_level);
  CHECK(fkm(Level::full, robot, q, x).status == Status::no_full_level && x == robot.home);
}

TEST("the full level is as honest as the ideal one about what it cannot answer") {
  for_each_full([](const Mechanism& mechanism) {
    const Robot& robot = mechanism.robot;
    Coordinates x = robot.home;
    Joint q{};
    x[1] += 5;
    const Outcome far = ikm(Level::full, robot, x, q);
    CHECK(far.status == Status::unreachable && far.chain >= 0);
    for (const double bad : {NAN, INFINITY}) {
      x = robot.home;
      x[0] = bad;
      CHECK(!ikm(Level::full, robot, x, q));
      CHECK(ikm(Level::ideal, robot, robot.home, q));
      CHECK(!fkm(Level::full, robot, q, x));
      x = robot.home;
      q[1] = bad;
      CHECK(fkm(Level::full, robot, q, x).status == Status::not_finite);
    }
    Robot short_rod = robot;
    short_rod.chain[1].rod_difference = -2.1 * robot.chain[1].rod;
    x = robot.home;
    const Outcome none = ikm(Level::full, short_rod, x, q);
    CHECK(none.status == Status::unreachable && none.chain == 1);
    Robot apart = robot;
    apart.chain[1].base.x() = -3;
    CHECK(ikm(Level::ideal, robot, robot.home, q));
    x = robot.home;
    CHECK(fkm(Level::full, apart, q, x).status == Status::not_converged);
    // From the other side of the motors Newton finds the mirrored pose: another mode.
    Robot mirrored = robot;
    mirrored.full.sign = -robot.full.sign;
    x = robot.home;
    CHECK(fkm(Level::full, mirrored, q, x).status == Status::branch_lost);
    for (int i = 0; i < robot.motors; ++i)
      mirrored.chain[i].working_mode = -robot.chain[i].working_mode;
    mirrored.full.sign = robot.full.sign;
    x = robot.home;
    CHECK(fkm(Level::full, mirrored, q, x).status == Status::branch_lost);
  });
  // Towards the end of its reach an arm and its rods stretch into one line: no speed along it.
  const Robot robot = h4().robot;
  double inside = 0, outside = 1;
  Joint q{};
  for (int k = 0; k < 60; ++k) {
    const double y = 0.5 * (inside + outside);
    (ikm(Level::ideal, robot, {0, y, -0.4, 0}, q) ? inside : outside) = y;
  }
  JointMatrix J{};
  const Outcome outcome = jacobian(Level::full, robot, {0, inside, -0.4, 0}, J);
  CHECK(outcome.status == Status::singular && outcome.chain >= 0);
}

TEST_EACH(for_each_full,
          "random motors and guesses end in a status and at most 60 steps, never in a NaN") {
  check::Random random(97);
  for (long k = 0; k < check::sample_size(2000); ++k) {
    Coordinates x = random_joint(random, 2);
    const FkmResult result = fkm(Level::full, robot, random_joint(random, 4), x);
    CHECK(result.iterations <= kFkmIterations && (!result || all_finite(x, n)));
    CHECK(!result || result.residual < 1e-12);
    Joint q{};
    CHECK(!ikm(Level::full, robot, random_joint(random, 1), q) || all_finite(q, n));
  }
}
