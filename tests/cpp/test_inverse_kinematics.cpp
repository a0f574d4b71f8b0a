// Inverse kinematics, poses and rotations.
#include "control/command.hpp"
#include "control/trajectory.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;
using reference::turn;

TEST_EACH(for_each, "every loop closes to rounding") {
  check::Random random(1);
  for (int k = 0; k < 1000; ++k) {
    const Pose pose = any_pose(random);
    Closure closure;
    const Outcome closed = ikm(robot, pose, closure);
    CHECK(closed && closed.chain == -1);
    for (int i = 0; i < motors; ++i) {
      const Chain& chain = robot.chain[i];
      // From the encoder's reading alone, by the formulas of docs/model.md.
      const double position = closure.chain[i].q + chain.encoder_offset;
      const Vec3 A = pose.D + pose.R * chain.pivot + chain.anchor;
      Vec3 B = chain.base;
      double rod = chain.rod;
      if (chain.actuator == Actuator::revolute)
        B += chain.arm * (turn(position, chain.axis) * chain.zero);
      else if (chain.actuator == Actuator::prismatic)
        B += position * chain.axis;
      else
        rod = position;
      CHECK_NEAR((B - A).norm(), rod, 3e-15);
      CHECK_NEAR((closure.chain[i].v - (B - A)).norm(), 0, 3e-15);
    }
  }
}

TEST("a rod is too short for the nearest point that its motor reaches, too long for the farthest") {
  check::Random random(4);
  long apart[3] = {};
  for_each([&](const Mechanism& mechanism) {
    for (int i = 0; i < mechanism.robot.motors; ++i) {
      const Chain& chain = mechanism.robot.chain[i];
      for (int sample = 0; sample < 40; ++sample) {
        const Vec3 d = 0.4 * Vec3(random(), random(), random()) * (1 + sample % 4);
        double nearest = INFINITY, farthest = 0;
        for (int k = -10000; k <= 10000; ++k) {  // a turn, or 4 m of a rail
          const double distance = (d - driven_point(chain, 2e-4 * std::numbers::pi * k).p).norm();
          nearest = std::min(nearest, distance);
          farthest = std::max(farthest, distance);
        }
        double short_by = std::max(nearest - chain.rod, 0.0);
        if (chain.actuator == Actuator::revolute && farthest < chain.rod)
          short_by = farthest - chain.rod;
        if (chain.actuator == Actuator::telescopic) short_by = 0;
        CHECK_NEAR(shortfall(chain, d), short_by, 1e-6);
        ++apart[short_by > 0 ? 2 : short_by < 0 ? 0 : 1];
      }
    }
  });
  for (const long cases : apart) CHECK(cases > 20);
}

TEST_EACH(for_each, "a telemeter's point is on its line and on the nacelle's plane") {
  Robot robot = mechanism.robot;
  robot.r = 2;
  check::Random random(3);
  for (int k = 0; k < 200; ++k) {
    const Pose pose = any_pose(random);
    Extended q_e;
    CHECK(extended(Level::ideal, robot, pose, q_e));
    for (int s = 0; s < 2; ++s) {
      const Sensor& sensor = robot.sensor[s];
      if (sensor.kind == SensorKind::platform_angle) {
        CHECK_NEAR(q_e[motors + s], pose.theta, 0);
        continue;
      }
      const Vec3 point = sensor.origin + q_e[motors + s] * sensor.direction;
      const Vec3 in_nacelle = pose.R.transpose() * (point - pose.D);
      CHECK_NEAR(sensor.normal.dot(in_nacelle - sensor.target), 0, 2e-15);
    }
  }
}

TEST("rotations: log undoes exp at the identity, near it, at random and near π") {
  check::Random random(4);
  CHECK_NEAR(log_so3(exp_so3(Vec3::Zero())).norm(), 0, 0);
  const double pi = std::numbers::pi;
  const double angles[]{1e-300, 1e-12, 1e-8, 0.99e-4,   1.01e-4,   1e-2,
                        1,      2,     3,    pi - 1e-3, pi - 1e-7, pi - 1e-9};
  for (const double angle : angles)
    for (int k = 0; k < 500; ++k) {
      const Vec3 axis = Vec3(random(), random(), random()).normalized();
      const Mat3 R = exp_so3(angle * axis);
      CHECK_NEAR((R * R.transpose() - Mat3::Identity()).norm(), 0, 3e-15);
      CHECK_NEAR((R - turn(angle, axis)).norm(), 0, 3e-15);
      CHECK_NEAR((log_so3(R) - angle * axis).norm(), 0, 1e-14);
    }
  // At π exactly the axis' sign is free.
  const Mat3 half = turn(pi, Vec3(1, 2, -2) / 3);
  CHECK_NEAR((exp_so3(log_so3(half)) - half).norm(), 0, 1e-14);
}

TEST_EACH(for_each, "difference() undoes moved(), for small steps and large ones") {
  check::Random random(5);
  for (const double size : {0.0, 1e-12, 1e-6, 0.009, 0.011, 0.3, 1.5})
    for (int k = 0; k < 100; ++k) {
      const Pose start = any_pose(random);
      const Coordinates step = random_joint(random, size);
      const Pose end = moved(K, start, step);
      const Coordinates back = difference(K, end, start);
      for (int i = 0; i < n; ++i) CHECK_NEAR(back[i], step[i], 1e-14);
      CHECK_NEAR((end.R.transpose() * end.R - Mat3::Identity()).norm(), 0, 3e-15);
      CHECK_NEAR(distance(K, to_pose(K, to_coordinates(K, end)), end), 0, 3e-15);
    }
}

TEST_EACH(
    for_each,
    "the quintic starts and ends at rest, and its rate and acceleration are its derivatives") {
  check::Random random(6);
  const Coordinates from = any_x(random), to = any_x(random);
  const double T = 0.2, h = 1e-5;
  for (const double time : {-1.0, 0.0, T, 5.0}) {
    const Setpoint point = quintic(K, from, to, T, time);
    const Coordinates& expected = time > 0 ? to : from;
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(point.x[i], expected[i], 1e-15);
      CHECK_NEAR(point.rate[i], 0, 0);
      CHECK_NEAR(point.acceleration[i], 0, 1e-12);
    }
  }
  for (double time = 0.01; time < T; time += 0.01) {
    const Setpoint before = quintic(K, from, to, T, time - h), at = quintic(K, from, to, T, time),
                   after = quintic(K, from, to, T, time + h);
    const Coordinates step = difference(K, to_pose(K, after.x), to_pose(K, before.x));
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(step[i] / (2 * h), at.rate[i], 1e-7);
      CHECK_NEAR((after.rate[i] - before.rate[i]) / (2 * h), at.acceleration[i], 1e-5);
    }
  }
}

TEST_EACH(for_each, "a machine's targets are in its own assembly mode") {
  Robot robot = mechanism.robot;
  Joint q{}, same{};
  CHECK(ikm(Level::ideal, robot, robot.home, q) && command(Level::ideal, robot, robot.home, same) &&
        same == q);
  robot.assembly_sign *= -1;  // as if home were in the other
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  const bool told_apart = motors == n;  // by the sign of det J_x
  CHECK((command(Level::ideal, robot, robot.home, same).status == Status::branch_lost) ==
        told_apart);
  const bool full = robot.full.kind == FullKind::exists || robot.full.kind == FullKind::same;
  robot.full.sign *= -1;
  if (full && told_apart)
    CHECK(command(Level::full, robot, robot.home, same).status == Status::branch_lost);
  robot = mechanism.robot;
  if (full || robot.full.own())
    CHECK(command(Level::full, robot, robot.home, same));  // elastic, too
  robot.chain[0].low = 99;
  static_cast<void>(finish(robot));
  CHECK(command(Level::ideal, robot, robot.home, same).status == Status::joint_limit);
}
