// A robot in plain C++: the H4 of robots/h4, for a controller that reads no robot file.
#pragma once

#include <numbers>

#include "truepose/core.hpp"

/// Known to the compiler, so that it builds for four chains alone.
inline constexpr truepose::Mobility kH4 = truepose::Mobility::schoenflies;  // x, y, z, θ

/// @return why it is no robot, if it is none: every part and the pose at home are looked at
inline truepose::Outcome make_h4(truepose::Robot& robot) {
  using namespace truepose;
  constexpr double h = 0.06, d = 0.06, R = 0.14, count = 2 * std::numbers::pi / 14400;
  const Vec3 base[]{{h + R, d, 0}, {-(h + R), d, 0}, {-h, -(d + R), 0}, {h, -(d + R), 0}};
  const Vec3 axis[]{{0, 1, 0}, {0, -1, 0}, {1, 0, 0}, {1, 0, 0}};
  const Vec3 zero[]{{1, 0, 0}, {-1, 0, 0}, {0, -1, 0}, {0, -1, 0}};
  const int bar[]{0, 1, 1, 0};  // chains 1 and 4 carry one lateral bar, 2 and 3 the other

  robot = {};
  robot.mobility = kH4;
  robot.chains = robot.motors = 4;
  robot.home = {0, 0, -0.4, 0};
  for (int i = 0; i < 4; ++i) {
    Chain& chain = robot.chain[i];
    chain.base = base[i];
    chain.axis = chain.pair_axis = chain.pair_drawn = axis[i];
    chain.zero = zero[i];
    chain.arm = 0.26;
    chain.rod = 0.48;
    chain.rod_spacing = 0.08;
    chain.bar = bar[i];
    chain.pivot = Vec3(bar[i] == 0 ? h : -h, 0, 0);
    chain.anchor = Vec3(0, i < 2 ? d : -d, 0);
    chain.encoder_step = count;
    chain.low = -std::numbers::pi / 6;
    chain.high = std::numbers::pi / 2;
    chain.torque_limit = 30;
    chain.drive_inertia = 0.017;
    chain.arm_mass = 0.30;
    chain.rod_mass = 0.10;
  }

  robot.bodies = 3;  // the nacelle and its two bars
  robot.body[0].mass = 0.60;
  robot.body[0].inertia = Vec3(0, 0, 0.00156).asDiagonal();
  for (int k = 0; k < 2; ++k) {
    robot.body[1 + k].mass = 0.20;
    robot.body[1 + k].bar = k;
    robot.body[1 + k].pivot = Vec3(k == 0 ? h : -h, 0, 0);
  }

  robot.r = 1;  // θ, on the tool axis, which turns four times as far as the nacelle
  robot.sensor[0].kind = SensorKind::platform_angle;
  robot.sensor[0].step = count / 4;
  robot.sensor[0].eccentricity.gear = 4;

  const Outcome outcome = finish(robot);
  return outcome ? finish_full(robot) : outcome;
}
