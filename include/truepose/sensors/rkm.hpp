// The redundant kinematic model (RKM): readings of all redundant sensors at a pose.
#pragma once

#include "truepose/sensors/sensor.hpp"

namespace truepose {
/// r = RKM(x) and J_r = ∂r/∂x (r rows of n) at a closed pose.
/// @return not_finite: no reading (telemeter along its own plane, rod across its joint's plane), or
/// no derivative (draw-wire of zero length)
template <Mobility K>
inline Outcome rkm(const Robot& robot, const Closure<K>& closure, Reading& values,
                   Matrix<kMaxSensors, kDof<K>>& jr) {
  Real sum = 0;  // a NaN shows in it
  for (int k = 0; k < robot.r; ++k) {
    sum += values[k] = sensor_reading<K>(robot, robot.sensor[k], closure, jr[k].data());
    for (const Real entry : jr[k]) sum += entry;
  }
  return {std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}

inline Outcome rkm(const Robot& robot, const Coordinates& x, Reading& values) {
  return with_mobility(robot.mobility, [&]<Mobility K>(Fixed<K>) -> Outcome {
    Closure<K> closure;
    Matrix<kMaxSensors, kDof<K>> jr;
    const Outcome outcome = ikm<K>(robot, to_pose<K>(x), closure);
    return outcome ? rkm<K>(robot, closure, values, jr) : outcome;
  });
}

/// Extended positions q_e = [q; r].
template <Mobility K>
inline void extend(const Robot& robot, const Joint& q, const Reading& r, Extended& q_e) {
  for (int i = 0; i < kDof<K>; ++i) q_e[i] = q[i];
  for (int k = 0; k < robot.r; ++k) q_e[kDof<K> + k] = r[k];
}

template <Mobility K>
inline Joint motors_of(const Extended& q_e) {
  Joint q{};
  std::copy_n(q_e.begin(), kDof<K>, q.begin());
  return q;
}

/// q_e at a pose, as the robot's own encoders read them.
template <Mobility K>
inline Outcome extended(const Robot& robot, const Pose& pose, Extended& q_e) {
  Closure<K> closure;
  Outcome outcome = ikm<K>(robot, pose, closure);
  Reading values;
  Matrix<kMaxSensors, kDof<K>> jr;
  if (outcome) outcome = rkm<K>(robot, closure, values, jr);
  if (outcome) extend<K>(robot, closure.q(), values, q_e);
  return outcome;
}
}  // namespace truepose
