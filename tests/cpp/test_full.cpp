// Closure of every rod when the axes are not exact. The full level against its own closures.
#include "full_robots.hpp"
#include "mechanism/levels.hpp"

using namespace mechanisms;

namespace {

/// Largest gap of a rod, from the points themselves: what full.hpp's algebra must come to.
double largest_gap(const Robot& robot, const FullPose& pose, const Joint& q) {
  double gap = 0;
  for (int i = 0; i < robot.motors; ++i) {
    const Chain& chain = robot.chain[i];
    const Mat3 R = chain.bar < 0 ? pose.R : pose.R * rotation_z(pose.psi[chain.bar]);
    for (const double side : {1.0, -1.0}) {
      const double half = 0.5 * side * chain.rod_spacing;
      const Vec3 B = chain.base + driven_point(chain, q[i]).p + half * pair_direction(chain);
      const Vec3 A = pose.D + pose.R * chain.pivot + R * (chain.anchor + half * chain.pair_drawn);
      const double length = chain.rod + 0.5 * side * chain.rod_difference;
      gap = std::max(gap, std::fabs((B - A).norm() - length));
    }
  }
  return gap;
}

}  // namespace

TEST_EACH(for_each_full,
          "every rod closes to 1e-12 m with 0.1° of yaw and tilt, 1e4 geometries, none lost") {
  check::Random random(93);
  double gap = 0, worst = 0;
  long lost = 0;
  int most = 0;
  const long robots = check::sample_size(10000);
  for (long k = 0; k < robots; ++k) {
    Robot robot = with_axis_errors(mechanism.robot, random);
    for (int i = 0; i < robot.motors; ++i) robot.chain[i].rod_difference = 2e-5 * gaussian(random);
    if (!finish_full(robot) || robot.full.kind != FullKind::exists) ++lost;
    const Pose pose = any_pose(random);
    FullClosure closure, back;
    const FkmResult there = ikm(robot, pose, closure);
    gap = std::max(gap, largest_gap(robot, closure.pose, closure.q()));
    FullPose near = to_full(nearby(K, pose, random, 1e-3)), far = to_full(to_pose(K, robot.home));
    const FkmResult once = fkm(robot, closure.q(), near, back);
    const FkmResult again = fkm(robot, closure.q(), far, back);
    if (!there || !once || !again) ++lost;
    for (const FullPose& found : {near, far}) {
      gap = std::max(gap, largest_gap(robot, found, closure.q()));
      worst = std::max(
          {worst, distance(K, found, pose), distance(Mobility::spatial, found, closure.pose)});
      for (int k = 0; k < robot.full.bars; ++k)
        worst = std::max(worst, std::fabs(found.psi[k] - closure.pose.psi[k]));
    }
    most = std::max({most, there.iterations, once.iterations, again.iterations});
  }
  CHECK(lost == 0);
  CHECK_NEAR(gap, 0, 1e-12);
  CHECK_NEAR(worst, 0, 1e-11);
  CHECK(most <= 16);
}

TEST("a tilt that keeps θ has the two turns asked for, and leaves θ where it was") {
  check::Random random(35);
  for (int sample = 0; sample < 1000; ++sample) {
    const double theta = 3 * random(), x = 0.3 * random(), y = 0.3 * random();
    const Vec3 turn = tilt_keeping(theta, x, y);
    const Mat3 R = exp_so3(turn) * rotation_z(theta);
    CHECK(turn.x() == x && turn.y() == y && std::fabs(turn.z()) < 0.1);
    CHECK_NEAR(theta_of(R, theta), theta, 1e-15);
  }
}

/// Energy of the rods' stretches f/L, for stiffness 1.
double energy(const Robot& robot, const FullPose& pose, const Joint& q) {
  Built built;
  build(robot, Layout::free, built);  // any pose, no rod relaxed
  engine::Position at;
  at.y = stand(robot, built, q, pose);
  for (int k = 0; k < robot.full.bars; ++k) at.y[built.turn_of(robot, k)] = pose.psi[k];
  engine::place(built.mechanism, at);
  double sum = 0;
  for (int rod = 0; rod < built.mechanism.closures; ++rod)
    sum += 0.5 * std::pow(at.f[rod] / robot.chain[rod / 2].rod, 2);
  return sum;
}

TEST(
    "one rod too many: the mechanism takes the pose of least energy, and IKM and FKM agree on it") {
  constexpr Mobility K = Mobility::schoenflies;
  const Mechanism mechanism = par4();
  check::Random random(99);
  double slope = 0, apart = 0, held = 1;
  const long robots = check::sample_size(500);
  for (long k = 0; k < robots; ++k) {
    Robot robot = with_axis_errors(mechanism.robot, random);
    for (int i = 0; i < robot.motors; ++i) robot.chain[i].rod_difference = 2e-5 * gaussian(random);
    CHECK(finish_full(robot) && robot.full.kind == FullKind::elastic);
    const Pose pose = to_pose(K, random_pose(mechanism, random));
    FullClosure there, back;
    CHECK(ikm(robot, pose, there));
    FullPose found = to_full(nearby(K, pose, random, 1e-3));
    CHECK(fkm(robot, there.q(), found, back));
    apart = std::max(apart, distance(K, found, pose));
    CHECK_NEAR(found.psi[0], found.psi[1], 0);
    const double rest = energy(robot, found, there.q()), h = 1e-5;
    held = std::min(held, rest);
    for (int freedom = 0; freedom < 7; ++freedom) {
      double side[2];
      for (const int s : {0, 1}) {
        FullPose moved = found;
        const double step = (2 * s - 1) * h;
        if (freedom < 3) moved.D[freedom] += step;
        if (freedom >= 3 && freedom < 6)
          moved.R = exp_so3(step * Vec3::Unit(freedom - 3)) * moved.R;
        if (freedom == 6) moved.psi[0] += step, moved.psi[1] += step;
        side[s] = energy(robot, moved, there.q());
      }
      slope = std::max(slope, std::fabs(side[1] - side[0]) / (2 * h));
    }
  }
  CHECK_NEAR(slope, 0, 1e-9);  // the difference is good to h²
  CHECK_NEAR(apart, 0, 1e-11);
  CHECK(held > 0);
}

TEST_EACH(for_each_full, "a solution that starts at its neighbour's is the same, in fewer steps") {
  check::Random random(101);
  long cold = 0, warm = 0;
  double apart = 0;
  for (int k = 0; k < 200; ++k) {
    Robot robot = with_axis_errors(mechanism.robot, random);
    CHECK(finish_full(robot));
    const Pose pose = any_pose(random);
    const Pose next = nearby(K, pose, random, 1e-3);
    FullClosure first, from_ideal, from_near;
    Parasitic rest;
    CHECK(ikm(robot, pose, first, &rest) && rest.known);
    const FkmResult one = ikm(robot, next, from_ideal);
    const FkmResult other = ikm(robot, next, from_near, &rest);
    CHECK(one && other);
    cold += one.iterations;
    warm += other.iterations;
    for (int i = 0; i < n; ++i)
      apart = std::max(apart, std::fabs(from_ideal.q()[i] - from_near.q()[i]));
    apart = std::max(apart, (from_ideal.pose.R - from_near.pose.R).norm());
  }
  CHECK_NEAR(apart, 0, 1e-13);
  CHECK(warm < 0.75 * cold);
}
