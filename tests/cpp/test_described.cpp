// Robots described by bodies and closures: kinematics, readings and their derivatives.
#include "control/law.hpp"
#include "derivative.hpp"
#include "described.hpp"
#include "mechanism/geometry.hpp"

using namespace mechanisms_described;

namespace {

struct Readings {
  Extended q_e{};
  PoseRows H_x{};
  std::vector<double> H_xi;
};
Readings read_at(const Robot& robot, const Pose& pose) {
  Readings at;
  at.H_xi.resize(readings(robot) * parameter_count(robot));
  CHECK(linearise(Level::ideal, robot, pose, at.q_e, at.H_x, at.H_xi.data()));
  return at;
}

}  // namespace

TEST_EACH(for_each_described, "the pose is found again from home, 1000 times, at either level") {
  const Robot& robot = mechanism.robot;
  check::Random random(141);
  double apart = 0, slope = 0;
  for (long k = 0; k < check::sample_size(1000); ++k) {
    const Coordinates x = random_pose(mechanism, random);
    const Level level = k % 2 ? Level::full : Level::ideal;
    Joint q{};
    CHECK(ikm(level, robot, x, q));
    Coordinates found = robot.home;
    CHECK(fkm(level, robot, q, found));
    for (int j = 0; j < n; ++j) apart = std::max(apart, std::fabs(found[j] - x[j]));
    if (k >= 20) continue;
    JointMatrix J;
    CHECK(jacobian(level, robot, x, J));
    for (int i = 0; i < motors && motors == n; ++i) {
      const Extended by = derivative([&](double h) {
        Joint moved = q;
        moved[i] += h;
        Coordinates to = x;
        CHECK(fkm(level, robot, moved, to));
        Extended result{};
        std::copy_n(to.begin(), n, result.begin());
        return result;
      });
      for (int j = 0; j < n; ++j)
        slope = std::max(slope, std::fabs(J[j][i] - by[j]) / (1 + std::fabs(by[j])));
    }
  }
  CHECK_NEAR(apart, 0, 1e-10);
  CHECK_NEAR(slope, 0, 1e-7);
}

TEST_EACH(for_each_described, "random motors end in a status within the steps allowed") {
  const Robot& robot = mechanism.robot;
  check::Random random(145);
  for (const int cap : {1, 24, kFkmCap})
    for (int k = 0; k < 200; ++k) {
      Joint q{};
      for (int i = 0; i < motors; ++i) q[i] = 2 * random();
      Coordinates x = robot.home;
      const FkmResult result = fkm(Level::ideal, robot, q, x, cap);
      CHECK(result.iterations <= cap);
      CHECK(all_finite(x, n));
    }
}

TEST_EACH(for_each_described, "H_x and H_xi are the derivatives of every reading") {
  const Robot& robot = mechanism.robot;
  check::Random random(142);
  const int width = parameter_count(robot);
  std::vector<double> xi(width);
  CHECK(drawn_parameters(robot, xi.data()));
  for (int sample = 0; sample < 5; ++sample) {
    const Pose pose = to_pose(K, random_pose(mechanism, random));
    const Readings at = read_at(robot, pose);
    for (int j = 0; j < n; ++j) {
      const Extended slope = derivative([&](double h) {
        Coordinates step{};
        step[j] = h;
        return read_at(robot, moved(K, pose, step)).q_e;
      });
      for (int k = 0; k < readings(robot); ++k)
        CHECK_NEAR(at.H_x[k][j], slope[k], 1e-7 * (1 + std::fabs(slope[k])));
    }
    for (int column = 0; column < width; ++column) {
      const int of = column % kChainParameters;
      const auto is = [&](ChainParameter p) { return of == static_cast<int>(p); };
      const bool turns = robot.chain[0].actuator == Actuator::revolute;
      const bool shaft = is(ChainParameter::eccentricity_c1) ||
                         is(ChainParameter::eccentricity_s1) ||
                         is(ChainParameter::eccentricity_c2) || is(ChainParameter::eccentricity_s2);
      if (column < motors * kChainParameters &&
          (turns ? is(ChainParameter::encoder_buildup) : shaft))
        continue;  // only a shaft is off its centre, only a slide's line builds up
      const Extended slope = derivative([&](double h) {
        std::vector<double> changed = xi;
        changed[column] += h;
        Robot other = robot;
        CHECK(set_parameters(robot, changed.data(), other));
        return read_at(other, pose).q_e;
      });
      for (int k = 0; k < readings(robot); ++k)
        CHECK_NEAR(at.H_xi[k * width + column], slope[k], 1e-6 * (1 + std::fabs(slope[k])));
    }
  }
}

TEST_EACH(for_each_described,
          "readings without noise give their pose, a bound for its covariance") {
  const Robot& robot = mechanism.robot;
  check::Random random(143);
  Knowledge known;
  known.sigma.fill(1e-5);
  std::vector<double> work(estimate_work(robot, 0));
  for (int sample = 0; sample < 50; ++sample) {
    const Pose pose = to_pose(K, random_pose(mechanism, random));
    Pose found = to_pose(K, robot.home);
    const Estimate best =
        estimate(Level::ideal, robot, known, read_at(robot, pose).q_e, found, work.data());
    CHECK(best);
    for (int j = 0; j < n; ++j) CHECK_NEAR(found.D[j], pose.D[j], 1e-9);
  }
}

TEST_EACH(for_each_described, "every law corrects small errors of the motors by all readings") {
  const Robot& robot = mechanism.robot;
  Knowledge known;
  known.sigma.fill(1e-5);
  std::vector<double> work(estimate_work(robot, 0));
  const Weighing weighing{&known, work.data()};
  check::Random random(144);
  for (const LawProperties& law : kLawTable) {
    const Coordinates x = random_pose(mechanism, random);
    Coordinates step{}, there = x;
    for (int j = 0; j < n; ++j) there[j] += step[j] = 1e-7 * random();
    Joint q{};
    ServoCycle cycle;
    CHECK(ikm(Level::ideal, robot, x, q));
    const Extended q_e = read_at(robot, to_pose(K, there)).q_e;
    CHECK(servo_cycle(robot, law.law, x, q_e, cycle, 0, weighing));
    for (int i = 0; i < motors; ++i) CHECK_NEAR(cycle.error[i], q[i] - q_e[i], 1e-11);
  }
}

TEST_EACH(for_each_described, "what is modelled for chains alone refuses it") {
  const Robot& robot = mechanism.robot;
  Closure closure;
  CHECK(ikm(robot, to_pose(K, robot.home), closure).status == Status::no_chains);
  Pose pose = to_pose(K, robot.home);
  CHECK(fkm(robot, Joint{}, pose).status == Status::no_chains);
  Robot wrong = robot;
  wrong.sensor[0].chain = 7;
  CHECK(finish(wrong).status == Status::no_such_part);
  wrong = robot;
  wrong.mechanism.body[1].parent = 4;
  CHECK(finish(wrong).status == Status::no_such_part);
  wrong = robot;
  wrong.chain[1].low = 99;
  CHECK(finish(wrong).status == Status::joint_limit);
}
