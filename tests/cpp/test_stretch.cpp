// Compliance of rods, legs and belts under load.
#include "simulation/stretch.hpp"

#include "mechanisms.hpp"
#include "simulation/plant.hpp"

using namespace mechanisms;

namespace {

/// Calls f(mechanism, robot, level) at every level that a mechanism has: encoders of their
/// own, both sensors in use; where its rods are a pair, one longer than the other; bodies on bars;
/// heavy rods, and a base that is mounted askew.
template <class F>
void for_each_level(F&& f) {
  for_each([&](const Mechanism& mechanism) {
    Robot robot = mechanism.robot;
    robot.r = 2;
    for (int i = 0; i < robot.motors; ++i) {
      robot.chain[i].encoder_offset = 0.01 * i;
      robot.chain[i].encoder_gain = i == 1 ? -0.9 : 1 + 0.1 * i;
      if (robot.chain[i].actuator != Actuator::revolute) robot.chain[i].encoder_buildup = 0.04 * i;
      if (robot.full.kind == FullKind::exists) robot.chain[i].rod_difference = 2e-5 * (i + 1);
    }
    for (int i = 0; i < robot.motors; ++i) robot.chain[i].rod_mass *= 10;
    robot.gravity += Vec3(2, 1, 0);
    for (int k = 1; k < robot.bodies; ++k) {
      robot.body[k].bar = robot.chain[k == 1 ? 0 : 1].bar;
      robot.body[k].anchor = Vec3(0.02, 0.03 * k, 0.01);
    }
    CHECK(finish(robot) && finish_full(robot));
    f(mechanism, robot, Level::ideal);
    if (robot.full.own()) f(mechanism, robot, Level::full);
  });
}

/// Work that force and weights do from the base's origin to where a nacelle stands.
template <class Lever>
double work(const Robot& robot, const Load& load, const Pose& pose,
            const std::array<double, 2>& psi, bool full, Lever&& lever) {
  double sum = load.force.dot(pose.D);
  for (int k = 0; k < robot.bodies; ++k) {
    const Body& body = robot.body[k];
    Vec3 at = pose.D + pose.R * body.pivot;
    if (full) at += (body.bar < 0 ? pose.R : pose.R * rotation_z(psi[body.bar])) * body.anchor;
    sum += body.mass * robot.gravity.dot(at);
  }
  for (int i = 0; i < robot.motors; ++i)
    sum += 0.5 * robot.chain[i].rod_mass * robot.gravity.dot(pose.D + lever(i));
  return sum;
}

/// The same where the motors stand at q, near a pose.
double work_at(const Robot& robot, const Load& load, bool full, const Joint& q, const Pose& near) {
  if (full) {
    FullPose pose = to_full(near);
    FullClosure at;
    CHECK(fkm(robot, q, pose, at));
    return work(robot, load, at.pose, at.pose.psi, true,
                [&](int i) { return 0.5 * (at.at.A[2 * i] + at.at.A[2 * i + 1]) - at.pose.D; });
  }
  Pose pose = near;
  CHECK(fkm(robot, q, pose));
  Closure at;
  CHECK(ikm(robot, pose, at));
  return work(robot, load, at.pose, {}, false, [&](int i) { return at.chain[i].lever; });
}

Load some_load() {
  Load load;
  load.force = Vec3(30, -20, -70);
  return load;
}

}  // namespace

TEST("a rod's tension is the work that what hangs on the nacelle does when it becomes longer") {
  for_each_level([](const Mechanism& mechanism, const Robot& robot, Level level) {
    if (overdriven(robot)) return;  // there the smallest torques hold the arms' weights, too
    const bool full = level == Level::full;
    const Mobility K = mechanism.robot.mobility;
    constexpr double kLonger = 1e-5;
    check::Random random(81);
    for (int sample = 0; sample < 5; ++sample) {
      const Coordinates x = random_pose(mechanism, random, 0.8);
      const Pose pose = to_pose(K, x);
      const Load load = some_load();
      Pull by;
      CHECK(pull(level, robot, pose, load, by));
      Joint q{};
      CHECK(ikm(level, robot, x, q));
      for (int i = 0; i < robot.motors; ++i) {
        const auto slope = [&](auto&& change) {
          double at[2];
          for (const int side : {0, 1}) {
            Robot other = robot;
            change(other.chain[i], side ? kLonger : -kLonger);
            at[side] = work_at(other, load, full, q, pose);
          }
          return (at[1] - at[0]) / (2 * kLonger);
        };
        const double longer = slope([&](Chain& chain, double h) {
          if (chain.actuator == Actuator::telescopic)
            chain.encoder_offset += h / by.rate[i];
          else
            chain.rod += h;
        });
        CHECK_NEAR(longer, by.tension[i], 1e-4 * (100 + std::fabs(by.tension[i])));
        if (!full) continue;
        // Half the difference is on either rod: its work is half of one rod's tension over
        // the other's.
        const double apart = slope([](Chain& chain, double h) { chain.rod_difference += h; });
        const double length = robot.chain[i].rod;
        CHECK_NEAR(apart, by.difference[i] / (4 * length),
                   1e-4 * (100 + std::fabs(by.difference[i] / length)));
      }
    }
  });
}

TEST("an arm turns by its compliance times the torque at which its motor holds the load") {
  for_each_level([](const Mechanism& mechanism, const Robot& robot, Level level) {
    const bool full = level == Level::full;
    const Mobility K = mechanism.robot.mobility;
    std::vector<double> H_xi(kMaxReadings * parameter_count(robot));
    check::Random random(84);
    Robot flat = robot;  // bodies of the dynamics do not turn with their bars
    for (int k = 0; k < flat.bodies; ++k) flat.body[k].anchor = Vec3::Zero();
    for (int i = 0; i < robot.motors; ++i) flat.chain[i].rod_difference = 0;
    CHECK(finish(flat) && finish_full(flat));
    for (int sample = 0; sample < 5; ++sample) {
      const Pose pose = to_pose(K, random_pose(mechanism, random, 0.8));
      Joint arms{}, torque{};
      arms.fill(1e-5);
      UnderLoad stiff, soft;
      CHECK(under_load(level, flat, pose, {}, {}, {}, H_xi.data(), stiff));
      CHECK(under_load(level, flat, pose, {}, arms, {}, H_xi.data(), soft));
      CHECK(hold(flat, pose, torque));
      for (int i = 0; i < robot.motors; ++i) {
        const bool arm = flat.chain[i].actuator == Actuator::revolute;
        const double turns = arm ? flat.chain[i].encoder_gain * torque[i] : 0;
        const double off = full ? 1e-3 * (1 + std::fabs(turns)) : 1e-9;
        CHECK_NEAR(soft.by_compliance[i][flat.motors + i], turns, off);
        CHECK_NEAR(soft.q_e[i] - stiff.q_e[i], 1e-5 * turns, 1e-5 * off + 1e-13);
      }
      for (int c = robot.motors; c < readings(robot); ++c)
        CHECK_NEAR(soft.q_e[c], stiff.q_e[c], 1e-13);
    }
  });
}

TEST("what carries nothing, or is stiff, stays as long as it is") {
  for_each_level([](const Mechanism& mechanism, const Robot& robot, Level level) {
    const Mobility K = mechanism.robot.mobility;
    std::vector<double> H_xi(kMaxReadings * parameter_count(robot));
    const Pose pose = to_pose(K, mechanism.robot.home);
    Robot weightless = robot;
    weightless.gravity = Vec3::Zero();
    Extended q_e;
    PoseRows H_x;
    Parasitic rest;
    CHECK(linearise(level, robot, pose, q_e, H_x, H_xi.data(), &rest));
    Joint soft;
    soft.fill(1e-5);
    for (const bool stiff : {false, true}) {
      UnderLoad at;
      CHECK(under_load(level, stiff ? robot : weightless, pose, stiff ? Joint{} : soft,
                       stiff ? Joint{} : soft, stiff ? some_load() : Load{}, H_xi.data(), at));
      for (int c = 0; c < readings(robot); ++c) CHECK_NEAR(at.q_e[c], q_e[c], 1e-12);
    }
  });
}

TEST("two rods share what is measured of their tension beyond what the load explains") {
  for_each_level([](const Mechanism& mechanism, const Robot& robot, Level level) {
    const bool full = level == Level::full;
    const Mobility K = mechanism.robot.mobility;
    check::Random random(83);
    const Pose pose = to_pose(K, random_pose(mechanism, random, 0.8));
    Load load = some_load();
    Pull computed, measured;
    measured.difference.fill(1);
    CHECK(pull(level, robot, pose, load, computed));
    for (int i = 0; i < robot.motors; ++i) load.tension[i] = computed.tension[i] + 10 * (i + 1);
    CHECK(pull(level, robot, pose, load, measured));
    Closure at;
    CHECK(ikm(robot, pose, at));
    for (int i = 0; i < robot.motors; ++i) {
      const double more = 10 * (i + 1);
      const Chain& chain = robot.chain[i];
      const bool leg = chain.actuator == Actuator::telescopic;
      const double length = leg ? at.chain[i].v.norm() : double(chain.rod);
      const double apart = full ? chain.rod_difference : 0;
      CHECK_NEAR(measured.tension[i], computed.tension[i] + more, 1e-9);
      CHECK_NEAR(measured.length[i] - computed.length[i], more * length, 1e-9);
      CHECK_NEAR(measured.difference[i] - computed.difference[i], more * apart, 1e-9);
      CHECK(full || measured.difference[i] == 0);
      CHECK_NEAR(measured.rate[i], at.chain[i].rate, 1e-3 * std::fabs(at.chain[i].rate));
    }
  });
}

TEST("rods that hold nothing along a freedom have no tension") {
  for_each_level([](const Mechanism&, const Robot& robot, Level level) {
    const bool full = level == Level::full;
    const Mobility K = robot.mobility;
    Pull by;
    Robot other = robot;
    other.finished = false;
    const Pose pose = to_pose(K, robot.home);
    const Outcome unfinished = pull(level, other, pose, some_load(), by);
    CHECK(unfinished.status == Status::unfinished && unfinished.chain == -1);
    other = robot;
    for (int i = 0; i < robot.motors; ++i) other.chain[i] = robot.chain[0];
    const Outcome outcome = pull(level, other, pose, some_load(), by);
    CHECK(full ? !outcome : outcome.status == Status::singular && outcome.chain == -1);
  });
}
