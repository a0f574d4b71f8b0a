// Statuses, never a NaN presented as an answer.
#include <limits>

#include "control/law.hpp"
#include "mechanism/fkm.hpp"
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

/// An answer is either finite or not ok.
void check_honest(bool ok, const auto& values, int n) { CHECK(!ok || all_finite(values, n)); }

}  // namespace

TEST("a pose out of reach is unreachable, and the chain is named") {
  for_each([](const Mechanism& mechanism) {
    Coordinates x = mechanism.robot.home;
    Joint q{};
    x[1] += 5;
    const Outcome outcome = ikm(Level::ideal, mechanism.robot, x, q);
    if (mechanism.robot.chain[0].actuator == Actuator::telescopic) {
      CHECK(outcome);  // a telescopic leg is as long as it has to be
    } else {
      CHECK(outcome.status == Status::unreachable);
      CHECK(outcome.chain >= 0 && outcome.chain < mechanism.robot.motors);
    }
  });
  Robot robot = h4().robot;  // chain 2 alone is too short
  robot.chain[2].rod = 0.1;
  Joint q{};
  const Outcome outcome = ikm(Level::ideal, robot, robot.home, q);
  CHECK(outcome.status == Status::unreachable && outcome.chain == 2);
}

TEST("motor positions that no pose holds are unreachable, by Newton and in closed form") {
  Robot robot = h4().robot;
  robot.chain[1].base.x() = -3;
  Coordinates x = robot.home;
  Joint q{0.5, 0.5, 0.5, 0.5};
  CHECK(fkm(Level::ideal, robot, q, x).status == Status::unreachable);
  Vec3 D;
  CHECK(fkm_closed(robot, q, Mat3::Identity(), Vec3(0, 0, -0.4), D).status == Status::unreachable);
}

TEST_EACH(for_each, "a telescopic leg has no negative and no zero length") {
  if (robot.chain[0].actuator != Actuator::telescopic) return;
  Joint q{};
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  for (const double factor : {-1.0, 0.0}) {
    Coordinates x = robot.home;
    Joint wrong = q, all{};
    wrong[1] *= factor;
    for (int i = 0; i < motors; ++i) all[i] = factor * q[i];
    const FkmResult result = fkm(Level::ideal, robot, wrong, x);
    CHECK(result.status == Status::unreachable && result.chain == 1);
    x = robot.home;
    CHECK(fkm(Level::ideal, robot, all, x).status == Status::unreachable);
  }
}

TEST("a stretched arm is singular of the first type, and the chain is named") {
  // At q_1 = 0 the arm points outwards; the rod in its continuation stretches chain 0.
  Robot robot = h4().robot;
  const Pose pose = to_pose(Mobility::schoenflies, robot.home);
  const Vec3 A = pose.D + robot.chain[0].pivot + robot.chain[0].anchor;
  const double reach = (A - robot.chain[0].base).norm();
  robot.chain[0].rod = reach - robot.chain[0].arm;
  JointMatrix J{};
  Outcome outcome = jacobian(Level::ideal, robot, robot.home, J);
  if (outcome.status == Status::unreachable) {  // by a rounding
    robot.chain[0].rod *= 1 + 1e-15;
    outcome = jacobian(Level::ideal, robot, robot.home, J);
  }
  CHECK(outcome.status == Status::singular && outcome.chain == 0);
}

TEST("a robot whose motors do not hold the nacelle is singular of the second type") {
  Robot robot = meeting_legs();
  robot.home = {};
  CHECK(finish(robot).status == Status::singular);
  CHECK(robot.assembly_sign == 0);
  JointMatrix J{};
  const Outcome outcome = jacobian(Level::ideal, robot, robot.home, J);
  CHECK(outcome.status == Status::singular && outcome.chain == -1);
  ExtendedColumns M;
  ExtendedRows M_plus;
  CHECK(tej(robot, robot.home, M, M_plus).status == Status::singular);
}

TEST("sphere centres on one line leave the closed form singular") {
  Robot robot = delta().robot;
  for (int i = 0; i < 3; ++i) {
    robot.chain[i] = robot.chain[0];
    robot.chain[i].base = Vec3(0.1 * i, 0, 0);
  }
  Vec3 D;
  const Outcome outcome =
      fkm_closed(robot, Joint{0.3, 0.3, 0.3}, Mat3::Identity(), Vec3(0, 0, -1), D);
  CHECK(outcome.status == Status::singular);
}

TEST("another assembly mode is a lost branch, not an answer") {
  // A Delta above its motors and a planar robot on the other side close the same loops.
  Robot robot = delta().robot;
  Coordinates x{};
  Joint q{};
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  x = robot.home;
  x[2] = 0.9;
  CHECK(fkm(Level::ideal, robot, q, x).status == Status::branch_lost);
  CHECK(x[2] > 0);
  Robot bar = five_bar().robot;
  CHECK(ikm(Level::ideal, bar, bar.home, q));
  x = bar.home;
  x[1] = -0.4;
  constexpr Mobility K = Mobility::planar_translation;
  Pose found = to_pose(K, x);
  CHECK(search(bar, q, found).status == Status::branch_lost);
}

TEST_EACH(for_each, "an arm in its other working mode is a lost branch, and the chain is named") {
  for (int i = 0; i < motors; ++i) {
    if (robot.chain[i].actuator == Actuator::telescopic) continue;
    Robot other = robot;
    other.chain[i].working_mode *= -1;
    Coordinates x = robot.home;
    Joint q{};
    CHECK(ikm(Level::ideal, other, other.home, q));
    other.chain[i].working_mode *= -1;
    const FkmResult result = fkm(Level::ideal, other, q, x);
    CHECK(result.status == Status::branch_lost && result.chain == i);
  }
}

TEST_EACH(for_each, "a number that is not finite is told from one that is out of reach") {
  Joint good{};
  CHECK(ikm(Level::ideal, robot, robot.home, good));
  for (int i = 0; i < n; ++i)
    for (const double bad : {kNan, kInf, -kInf}) {
      Coordinates x = robot.home;
      Joint q = good;
      x[i] = bad;
      CHECK(ikm(Level::ideal, robot, x, q).status == Status::not_finite);
      CHECK(fkm(Level::ideal, robot, good, x).status == Status::not_finite);  // as a guess
      x = robot.home;
      q = good;
      q[i] = bad;
      const FkmResult result = fkm(Level::ideal, robot, q, x);
      CHECK(result.status == Status::not_finite && result.chain == i);
      if (K == Mobility::schoenflies || K == Mobility::translation) {
        Vec3 D;
        CHECK(!fkm_closed(robot, q, Mat3::Identity(), to_pose(K, robot.home).D, D));
      }
    }
}

TEST("beside a singularity, where Newton crawls, the forward model keeps its bound") {
  Robot robot = meeting_legs();
  robot.assembly_sign = 0;
  Joint q{};
  CHECK(ikm(Level::ideal, robot, Coordinates{}, q));
  int iterations = 0;
  for (double turn = 1e-12; turn < 1; turn *= 1.1) {
    Coordinates x{1e-3 * turn, -2e-3 * turn, turn};
    const FkmResult result = fkm(Level::ideal, robot, q, x);
    iterations = std::max(iterations, result.iterations);
    check_honest(static_cast<bool>(result), x, 3);
  }
  CHECK(iterations <= 2 * kFkmIterations);
  CHECK(iterations > 8);  // it does crawl, or this test would show nothing
}

TEST("a singular pose towards which the search crawls is called singular") {
  Robot robot = meeting_legs();
  robot.home = {0.01, 0.02, 0.5};
  CHECK(finish(robot));
  check::Random random(22);
  for (int k = 0; k < 200; ++k) {
    Coordinates x = robot.home;
    Joint q{};
    CHECK(ikm(Level::ideal, robot, Coordinates{0.05 * random(), 0.05 * random(), 0}, q));
    const FkmResult result = fkm(Level::ideal, robot, q, x);
    CHECK(result.status == Status::singular && result.residual < 1e-9);
    for (int i = 0; i < 3; ++i) q[i] -= 0.01;  // shorter legs than any pose of the robot has?
    x = robot.home;
    const Status status = fkm(Level::ideal, robot, q, x).status;
    CHECK(status == Status::ok || status == Status::not_converged);
  }
}

TEST_EACH(
    for_each,
    "legs that some pose has are never called unreachable, wherever the pose and the guess are") {
  check::Random random(23);
  long told = 0;
  for (long k = 0; k < check::sample_size(2000); ++k) {
    Coordinates x = robot.home, found{};
    Joint q{};
    for (int i = 0; i < n; ++i) {
      x[i] += 8 * mechanism.box[i] * random();
      found[i] = robot.home[i] + 8 * mechanism.box[i] * random();
    }
    if (!ikm(Level::ideal, robot, x, q)) continue;
    ++told;
    CHECK(fkm(Level::ideal, robot, q, found).status != Status::unreachable);
  }
  CHECK(told > 20);
}

TEST("two rods that cannot meet are unreachable, whichever side of the four is too long") {
  const Robot robot = planar("3-RPR", Actuator::telescopic).robot;
  Joint good{};
  CHECK(ikm(Level::ideal, robot, robot.home, good));
  for (const double length : {0.01, 5.0}) {
    Coordinates x = robot.home;
    Joint q = good;
    q[0] = length;
    if (length < 1) q[1] = length;  // both at their own base points, farther apart than the pivots
    CHECK(fkm(Level::ideal, robot, q, x).status == Status::unreachable);
  }
  for_each([](const Mechanism& mechanism) {  // and a Delta's three spheres, exactly
    if (mechanism.robot.mobility != Mobility::translation) return;
    Robot narrow = mechanism.robot;
    Coordinates x = narrow.home;
    Joint q{};
    CHECK(ikm(Level::ideal, narrow, x, q));
    for (int i = 0; i < 3; ++i) narrow.chain[i].rod *= 0.2;
    CHECK(fkm(Level::ideal, narrow, q, x).status == Status::unreachable);
  });
}

TEST("a telemeter along its own plane reads nothing, and no function calls that ok") {
  Robot robot = h4().robot;
  robot.r = 2;
  robot.sensor[1] = telemeter({-0.6, 0, -0.4}, {1, 0, 0}, {0, 0, 0}, {0, 0, 1});
  ExtendedColumns M;
  ExtendedRows M_plus;
  CHECK(tej(robot, robot.home, M, M_plus).status == Status::not_finite);
  Extended q_e{};
  CHECK(extended(Level::ideal, robot, to_pose(Mobility::schoenflies, robot.home), q_e).status ==
        Status::not_finite);
}

TEST("every status has its own words") {
  std::vector<std::string> words;
  for (int i = static_cast<int>(Status::stopped); i <= static_cast<int>(Status::no_such_value);
       ++i) {
    words.emplace_back(describe(static_cast<Status>(i)));
    for (std::size_t j = 0; j + 1 < words.size(); ++j) CHECK(words[j] != words.back());
  }
  CHECK(std::string(describe(static_cast<Status>(99))) == "unknown status");
}
