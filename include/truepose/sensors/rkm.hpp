// The redundant kinematic model (RKM): readings of all redundant sensors at a pose.
#pragma once

#include "truepose/sensors/sensor.hpp"

namespace truepose {
/// r = RKM(x) and J_r = ∂r/∂x (r rows of n) at a closed pose.
/// @return not_finite: no reading (telemeter along its own plane, rod across its joint's plane), or
/// no derivative (draw-wire of zero length)
inline Outcome rkm(const Robot& robot, const Closure& closure, Reading& values,
                   SensorRows& jr) {
  Real sum = 0;  // a NaN shows in it
  for (int k = 0; k < robot.r; ++k) {
    sum += values[k] = sensor_reading(robot, robot.sensor[k], closure, jr[k].data());
    for (int j = 0; j < closure.carried.n; ++j) sum += jr[k][j];
  }
  return {std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}

inline Outcome rkm(const Robot& robot, const Coordinates& x, Reading& values) {
  Closure closure;
  SensorRows jr;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  return outcome ? rkm(robot, closure, values, jr) : outcome;
}

/// Extended positions q_e = [q; r].
inline void extend(const Robot& robot, const Joint& q, const Reading& r, Extended& q_e) {
  for (int i = 0; i < dof(robot.mobility); ++i) q_e[i] = q[i];
  for (int k = 0; k < robot.r; ++k) q_e[dof(robot.mobility) + k] = r[k];
}

inline Joint motors_of(const Robot& robot, const Extended& q_e) {
  Joint q{};
  std::copy_n(q_e.begin(), dof(robot.mobility), q.begin());
  return q;
}

/// q_e at a pose, as the robot's own encoders read them.
inline Outcome extended(const Robot& robot, const Pose& pose, Extended& q_e) {
  Closure closure;
  Outcome outcome = ikm(robot, pose, closure);
  Reading values;
  SensorRows jr;
  if (outcome) outcome = rkm(robot, closure, values, jr);
  if (outcome) extend(robot, closure.q(), values, q_e);
  return outcome;
}
}  // namespace truepose
