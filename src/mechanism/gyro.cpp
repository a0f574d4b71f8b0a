// Angular rate that a gyroscope on the platform reads: ω = W(x) ẋ, in the platform's frame.
#include "mechanism/gyro.hpp"

namespace truepose {
Outcome gyro(const Robot& robot, const Coordinates& x, GyroRows& W) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (is_mechanism(robot.mobility)) return {Status::no_chains, -1};
  const Pose pose = to_pose(robot.mobility, x);
  const Carried carried = carried_frames(robot, pose);
  const Mat3& R = carried.pose.R;
  Real sum = 0;  // becomes NaN if any value is
  for (int j = 0; j < dof(robot.mobility); ++j) {
    Coordinates rate{};
    rate[j] = 1;
    const Vec3 turn = R.transpose() * to_twist(carried, rate).omega;
    for (int k = 0; k < 3; ++k) W[k][j] = turn[k];
    sum += turn.sum();
  }
  return Outcome{std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}
}  // namespace truepose
