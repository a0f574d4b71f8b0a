// Motor errors of the laws, and their weights.
#include "mechanisms.hpp"

using namespace mechanisms;

TEST_EACH(for_each, "for readings that agree, every law sees the joint error to first order") {
  Robot robot = mechanism.robot;
  robot.r = 2;
  robot.sensor[1].weight = 16;
  check::Random random(62);
  for (int k = 0; k < 50; ++k) {
    const Coordinates x = any_x(random), direction = random_joint(random, 1);
    for (const Law law : kLaws) {
      Prior prior(robot);
      Reference reference;
      CHECK(refer(robot, law, x, reference, 0, prior.weighing()));
      const auto departure = [&](double size) {
        Coordinates step{};
        Joint joint{}, error{};
        Pose estimate;
        for (int i = 0; i < n; ++i) step[i] = size * direction[i];
        Extended q_e{};
        CHECK(extended(Level::ideal, robot, moved(K, reference.closure.pose, step), q_e));
        CHECK(motor_error(robot, Law::joint, reference, q_e, joint, estimate));
        CHECK(motor_error(robot, law, reference, q_e, error, estimate, prior.weighing()));
        double largest = 0;
        for (int i = 0; i < motors; ++i) {
          CHECK(std::fabs(joint[i]) < 30 * size);
          largest = std::max(largest, std::fabs(error[i] - joint[i]));
        }
        return largest;
      };
      CHECK_NEAR(departure(1e-4), 0, 3e-6);  // second order: 1e-8 times the curvature
      CHECK(departure(1e-5) < 0.011 * departure(1e-4) + 1e-13);
    }
  }
}

TEST_EACH(
    for_each,
    "weights that know nothing of the geometry and trust all readings alike are the paper's") {
  Robot robot = mechanism.robot;
  robot.r = 2;
  check::Random random(65);
  const Coordinates x = any_x(random);
  Knowledge known;
  known.sigma.fill(0.3);
  std::vector<double> work(estimate_work(robot, 0));
  Reference paper, weighted;
  CHECK(refer(robot, Law::tej, x, paper));
  CHECK(refer(robot, Law::weighted, x, weighted, 0, {&known, work.data()}));
  for (int i = 0; i < motors; ++i)
    for (int c = 0; c < readings(robot); ++c)
      CHECK_NEAR(weighted.tej[i][c], paper.tej[i][c], 1e-10);
}

TEST_EACH(for_each,
          "the Cartesian law takes every sensor: to first order it corrects as the paper's TEJ") {
  Robot robot = mechanism.robot;
  robot.r = 2;
  robot.sensor[1].weight = 16;
  check::Random random(78);
  for (int trial = 0; trial < 20; ++trial) {
    const Coordinates x = any_x(random);
    Reference paper, reference;
    CHECK(refer(robot, Law::tej, x, paper));
    CHECK(refer(robot, Law::cartesian, x, reference));
    for (int c = 0; c < readings(robot); ++c) {
      constexpr double kOff = 1e-5;
      Extended q_e = reference.q_e;
      q_e[c] -= kOff;
      Joint error{};
      Pose found;
      CHECK(motor_error(robot, Law::cartesian, reference, q_e, error, found));
      for (int i = 0; i < motors; ++i) CHECK_NEAR(error[i] / kOff, paper.tej[i][c], 2e-3);
    }
  }
}

TEST("where theta's sensor is the only one the Cartesian law is the paper's closed form") {
  const Robot robot = h4().robot;
  constexpr Mobility K = Mobility::schoenflies;
  Reference reference;
  CHECK(refer(robot, Law::cartesian, robot.home, reference));
  Extended q_e = reference.q_e;
  for (int c = 0; c <= dof(K); ++c) q_e[c] += 0.01 * (c + 1);  // far from agreeing
  Joint error{};
  Pose found, closed;
  CHECK(motor_error(robot, Law::cartesian, reference, q_e, error, found));
  CHECK(redundant_fkm(robot, q_e, reference.closure.pose.D, closed));
  CHECK(found.theta == closed.theta && (found.D - closed.D).squaredNorm() == 0);
  CHECK_NEAR(found.theta, 0.05, 1e-12);
}
