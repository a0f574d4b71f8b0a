// Angular rate that a gyroscope on the platform reads: ω = W(x) ẋ, in the platform's frame.
#include "mechanism/gyro.hpp"

namespace truepose {
Outcome gyro(const Robot& robot, const Coordinates& x, GyroRows& W) {
  if (!robot.finished) return {Status::unfinished};
  if (is_mechanism(robot.mobility)) return {Status::no_chains};
  const Pose pose = to_pose(robot.mobility, x);
  const Carried carried = carried_frames(robot, pose);
  const Mat3& R = carried.pose.R;
  for (int k : range(3)) free_row(carried, Vec3::Zero(), R.col(k), W[k].data());
  return {R.allFinite() ? Status::ok : Status::not_finite};
}
}  // namespace truepose
