// Forward kinematics. From the motors, from motors and angle.
#include "mechanism/fkm.hpp"
#include "mechanism/fkm_closed.hpp"
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {

Vec3 home_side(const Robot& robot) { return to_pose(robot.mobility, robot.home).D; }

/// Checks that D comes back, at one pose, from the motors and the orientation.
void check_closed(const Robot& robot, const Pose& pose) {
  Closure closure;
  CHECK(ikm(robot, pose, closure));
  Vec3 D;
  CHECK(fkm_closed(robot, closure.q(), pose.R, home_side(robot), D));
  CHECK_NEAR((D - pose.D).norm(), 0, 1e-12);
}

}  // namespace

TEST_EACH(for_each, "FKM(IKM(x)) = x from 1 mm and 1 mrad away, and from home") {
  const bool paper = robot.mobility == Mobility::schoenflies;
  const long poses = check::sample_size(paper ? 20000 : 4000);
  check::Random random(11);
  double worst = 0;
  long lost = 0;
  int iterations = 0;
  for (long k = 0; k < poses; ++k) {
    const Pose pose = any_pose(random);
    Closure closure;
    if (!ikm(robot, pose, closure)) ++lost;
    for (const Pose& guess : {nearby(K, pose, random, 1e-3), to_pose(K, robot.home)}) {
      Pose found = guess;
      const FkmResult result = fkm(robot, closure.q(), found);
      if (!result) ++lost;
      worst = std::max(worst, distance(K, found, pose));
      iterations = std::max(iterations, result.iterations);
    }
  }
  CHECK(lost == 0);
  CHECK_NEAR(worst, 0, 1e-12);
  CHECK(iterations <= 16);
}

TEST_EACH(
    for_each,
    "a cap below the steps that the FKM needs is said, and one of 12 does for a box from home") {
  check::Random random(12);
  for (int k = 0; k < 300; ++k) {
    const Coordinates x = any_x(random);
    Joint q;
    CHECK(ikm(Level::ideal, robot, x, q));
    const auto from_home = [&](int cap, Coordinates& found) {
      found = robot.home;
      return fkm(Level::ideal, robot, q, found, cap);
    };
    Coordinates found, again, short_of;
    const FkmResult free = from_home(kFkmCap, found), twelve = from_home(12, again);
    CHECK(free && twelve && again == found && twelve.iterations == free.iterations);
    const int cap = free.iterations - 2;
    const FkmResult capped = from_home(cap, short_of);
    CHECK(capped.status == Status::not_converged && capped.iterations == cap);
    Joint beyond = q;  // no pose: known without a step, or not found within the cap
    for (int i = 0; i < motors; ++i) beyond[i] += 1;
    CHECK(from_home(12, again).iterations <= 12);
  }
}

TEST_EACH(for_each,
          "from home the FKM finds the pose of the robot's own mode, however far it has turned") {
  if (K == Mobility::spatial) {
    const Robot& robot = mechanism.robot;
    check::Random random(16);
    long reached = 0, again = 0, lost = 0;
    for (long k = 0; k < check::sample_size(4000); ++k) {
      Pose pose = any_pose(random);
      const Vec3 axis = Vec3(random(), random(), random()).normalized();
      pose.R = exp_so3(degrees(60) * axis) * to_pose(K, robot.home).R;
      Closure closure;
      Jacobians jacobians;
      if (!ikm(robot, pose, closure) || !jacobian(closure, jacobians) ||
          jacobians.sign != robot.assembly_sign)
        continue;
      ++reached;
      Pose alone = to_pose(K, robot.home), found = alone;
      again += !search(robot, closure.q(), alone);
      if (!fkm(robot, closure.q(), found)) {
        ++lost;
        continue;
      }
      Closure closed;  // on the same motors
      CHECK(ikm(robot, found, closed));
      for (int i = 0; i < motors; ++i)
        CHECK_NEAR(std::remainder(closed.chain[i].q - closure.chain[i].q, 2 * std::numbers::pi), 0,
                   1e-9);
    }
    CHECK(reached > 400);
    // Some lie behind a singular pose: of the same sign, yet another mode.
    CHECK(lost <= reached / 25 && lost <= again / 2 + 2);  // a few, whose sign rounding decides
  }
}

TEST_EACH(for_each, "the residual the FKM reports is the largest gap that is left in a loop") {
  check::Random random(12);
  for (int k = 0; k < 200; ++k) {
    Closure closure;
    CHECK(ikm(robot, any_pose(random), closure));
    Pose pose = to_pose(K, robot.home);
    const FkmResult result = fkm(robot, closure.q(), pose);
    double gap = 0;
    for (int i = 0; i < motors; ++i) {
      const Driven driven = driven_point(robot.chain[i], closure.chain[i].q);
      const Vec3 A = pose.D + pose.R * robot.chain[i].pivot + robot.chain[i].anchor;
      gap = std::max(gap, std::fabs((robot.chain[i].base + driven.p - A).norm() - driven.rod));
    }
    CHECK_NEAR(gap, result.residual, 1e-15);
    CHECK_NEAR(gap, 0, 3e-15);
  }
}

TEST_EACH(for_each,
          "with the orientation known, position follows in closed form, equal to Newton's") {
  if (K == Mobility::schoenflies || K == Mobility::translation) {
    const Robot& robot = mechanism.robot;
    check::Random random(13);
    double worst = 0;
    long lost = 0;
    const long poses = check::sample_size(20000);
    for (long k = 0; k < poses; ++k) {
      const Pose pose = any_pose(random);
      Closure closure;
      if (!ikm(robot, pose, closure)) ++lost;
      Pose newton = nearby(K, pose, random, 1e-3);
      if (!fkm(robot, closure.q(), newton)) ++lost;
      Vec3 D = Vec3::Zero();
      if (!fkm_closed(robot, closure.q(), pose.R, home_side(robot), D)) ++lost;
      worst = std::max({worst, (D - pose.D).norm(), (D - newton.D).norm()});
    }
    CHECK(lost == 0);
    CHECK_NEAR(worst, 0, 1e-12);
  }
}

TEST("centres of the spheres in one plane, and almost in one, are no special case") {
  const Mechanism flat = par4();
  constexpr Mobility K = Mobility::schoenflies;
  check::Random random(15);
  // Equal motors of a symmetric robot put the four centres at one height; unequal by `tilt`,
  // almost.
  Robot robot = flat.robot;
  for (int i = 0; i < 4; ++i) {
    robot.chain[i].zero = polar(1, 45 + 90 * i);
    robot.chain[i].axis = Vec3::UnitZ().cross(robot.chain[i].zero);
    robot.chain[i].base = 0.275 * robot.chain[i].zero;
    robot.chain[i].arm = 0.375;
    robot.chain[i].rod = 0.8;
    robot.chain[i].pivot.z() = 0;
  }
  for (const double tilt : {0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3})
    for (int k = 0; k < 50; ++k)
      check_closed(robot, to_pose(K, {tilt * random(), tilt * random(), -0.65 + 0.05 * random(),
                                      tilt * random()}));
}

TEST_EACH(for_each, "both working modes of every arm are forward models of their own inverse") {
  check::Random random(16);
  Robot robot = mechanism.robot;
  int tried = 0;
  for (int modes = 0; modes < 1 << motors; ++modes) {
    for (int i = 0; i < motors; ++i) robot.chain[i].working_mode = modes >> i & 1 ? 1 : -1;
    if (!finish(robot)) continue;
    const Pose pose = to_pose(K, robot.home);
    Closure closure;
    Jacobians jacobians;
    CHECK(ikm(robot, pose, closure));
    double largest = 0;  // of J: how far 1e-5 m is from a singularity of this mode
    CHECK(jacobian(closure, jacobians));
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < motors; ++j) largest = std::max(largest, std::fabs(jacobians.J[i][j]));
    if (largest > 30) continue;
    ++tried;
    for (int i = 0; i < motors; ++i)
      CHECK(robot.chain[i].actuator == Actuator::telescopic ||
            closure.chain[i].jq * robot.chain[i].working_mode > 0);
    Pose found = nearby(K, pose, random, 1e-5);
    CHECK(fkm(robot, closure.q(), found));
    CHECK_NEAR(distance(K, found, pose), 0, 1e-12);
  }
  CHECK(tried >= 2);
}

TEST_EACH(for_each_overdriven,
          "of readings that no pose closes the FKM of redundant motors is their least squares") {
  check::Random random(17);
  for (int k = 0; k < 300; ++k) {
    Closure closure;
    Jacobians jacobians;
    const Pose pose = any_pose(random);
    CHECK(ikm(robot, pose, closure));
    Joint q = closure.q(), rest{};
    for (int i = 0; i < motors; ++i) q[i] += 1e-3 * random();
    Pose near = nearby(K, pose, random, 1e-3), far = to_pose(K, robot.home);
    const FkmResult result = fkm(robot, q, near);
    CHECK(result && fkm(robot, q, far));
    CHECK_NEAR(distance(K, near, far), 0, 1e-11);
    CHECK(result.residual > 1e-6 && result.residual < 2e-3 && result.iterations < 16);
    CHECK(ikm(robot, near, closure) && jacobian(closure, jacobians));
    for (int i = 0; i < motors; ++i) rest[i] = q[i] - closure.chain[i].q;
    const Coordinates step = pose_rate(jacobians, rest);  // to second order in the residual
    for (int j = 0; j < n; ++j) CHECK_NEAR(step[j], 0, 1e-4);
  }
  Joint q;
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  q[0] += 0.3;  // a reading of another posture
  Coordinates x = robot.home;
  CHECK(fkm(Level::ideal, robot, q, x).status == Status::not_converged);
}

TEST_EACH(for_each, "a leg far too long for the others has certainly no pose") {
  const Robot& robot = mechanism.robot;
  if (robot.chain[0].actuator != Actuator::telescopic) return;
  Joint q{};
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  q[0] *= 20;
  Coordinates x = robot.home;
  CHECK(fkm(Level::ideal, robot, q, x).status == Status::unreachable);
}
