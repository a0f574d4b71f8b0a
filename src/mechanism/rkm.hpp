// The redundant kinematic model (RKM): readings of all redundant sensors at a pose.
#pragma once

#include "mechanism/jacobian.hpp"
#include "mechanism/sensor.hpp"

namespace truepose {
/// r = RKM(x) and J_r = ∂r/∂x (r rows of n) at a closed pose.
/// @return not_finite: no reading (telemeter along its own plane, rod across its joint's plane), or
/// no derivative (draw-wire of zero length)
Outcome rkm(const Robot& robot, const Closure& closure, Reading& values, SensorRows& jr);

/// Extended positions q_e = [q; r].
inline void extend(const Robot& robot, const Joint& q, const Reading& r, Extended& q_e) {
  for (int i : range(robot.motors)) q_e[i] = q[i];
  for (int k : range(robot.r)) q_e[robot.motors + k] = r[k];
}

Joint motors_of(const Robot& robot, const Extended& q_e);
}  // namespace truepose
