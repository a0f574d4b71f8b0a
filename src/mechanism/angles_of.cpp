// Angles of the passive axes that bring the platform to a given position and orientation.
#include "mechanism/angles_of.hpp"

namespace truepose {
void angles_of(const Robot& robot, const Pose& seen, Pose& pose) {
  const int n = dof(robot.mobility);
  const Real unit = (robot.chain[0].base - robot.axis[0].origin).norm();
  for (int step = 0; step < kAngleSteps; ++step) {
    const Carried carried = carried_frames(robot, pose);
    const Vec3 turn = unit * log_so3(seen.R * carried.pose.R.transpose());
    Square by;
    Unknowns size{}, off;
    twist_row(seen.D - carried.pose.D, turn, off.data());
    for (int j : range(n)) {
      Unknowns column;
      twist_row(carried.linear[j], unit * carried.axis[j], column.data());
      for (int i : range(6)) by[i][j] = column[i], size[j] += column[i] * column[i];
    }
    const Factors factors(6, n, by.data(), size);
    if (!factors.regular()) return;
    const Unknowns motion = factors.solve(off.data());
    Real moved = 0;
    for (int j : range(n)) {
      pose.D[j] += motion[j];
      moved = max(moved, fabs(motion[j]));
    }
    if (!(moved > by_precision(1e-13, 1e-6))) return;
  }
}

Coordinates coordinates_of(const Robot& robot, const Pose& seen, const Coordinates& near) {
  const int n = dof(robot.mobility);
  Pose own = seen;
  if (is_rotational(robot.mobility)) {
    own = to_pose(robot.mobility, all_finite(near, n) ? near : robot.home);
    angles_of(robot, seen, own);
  } else {
    own.theta = theta_of(seen.R, isfinite(near[n - 1]) ? near[n - 1] : 0);
  }
  return to_coordinates(robot.mobility, own);
}
}  // namespace truepose
