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

Outcome rkm(const Robot& robot, const Coordinates& x, Reading& values) {
  Closure closure;
  SensorRows jr;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  return outcome ? rkm(robot, closure, values, jr) : outcome;
}

Joint motors_of(const Robot& robot, const Extended& q_e) {
  Joint q{};
  std::copy_n(q_e.begin(), robot.motors, q.begin());
  return q;
}

Outcome extended(const Robot& robot, const Pose& pose, Extended& q_e) {
  Closure closure;
  Outcome outcome = ikm(robot, pose, closure);
  Reading values;
  SensorRows jr;
  if (outcome) outcome = rkm(robot, closure, values, jr);
  if (outcome) extend(robot, closure.q(), values, q_e);
  return outcome;
}
}  // namespace truepose
