// The redundant kinematic model (RKM): readings of all redundant sensors at a pose.
#include "mechanism/rkm.hpp"

namespace truepose {
Outcome rkm(const Robot& robot, const Closure& closure, Reading& values, SensorRows& jr) {
  Real sum = 0;  // a NaN shows in it
  for (int k = 0; k < robot.r; ++k) {
    sum += values[k] = sensor_reading(robot, robot.sensor[k], closure, jr[k].data());
    for (int j = 0; j < closure.carried.n; ++j) sum += jr[k][j];
  }
  return {std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}

Joint motors_of(const Robot& robot, const Extended& q_e) {
  Joint q{};
  std::copy_n(q_e.begin(), robot.motors, q.begin());
  return q;
}
}  // namespace truepose
