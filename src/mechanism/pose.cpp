// Coordinates x, poses (D, R) and the free twists of a mobility.
#include "mechanism/pose.hpp"

namespace truepose {
Pose to_pose(Mobility mobility, const Coordinates& x) {
  Pose pose;
  for (int j : range(positions_of(mobility))) pose.D[j] = x[j];
  if (turns_about_z(mobility)) {
    pose.theta = x[dof(mobility) - 1];
    pose.R = rotation_z(pose.theta);
  }
  if (mobility == Mobility::spatial) pose.R = exp_so3(Vec3(x[3], x[4], x[5]));
  return pose;
}

Coordinates to_coordinates(Mobility mobility, const Pose& pose) {
  Coordinates x{};
  for (int j : range(positions_of(mobility))) x[j] = pose.D[j];
  if (turns_about_z(mobility)) x[dof(mobility) - 1] = pose.theta;
  if (mobility == Mobility::spatial) {
    const Vec3 w = log_so3(pose.R);
    for (int i : range(3)) x[3 + i] = w[i];
  }
  return x;
}

Pose moved(Mobility mobility, const Pose& pose, const Coordinates& step) {
  Pose result = pose;
  for (int j : range(positions_of(mobility))) result.D[j] += step[j];
  if (mobility == Mobility::spatial) result.R = exp_so3(Vec3(step[3], step[4], step[5])) * pose.R;
  if (turns_about_z(mobility)) {
    const Real turn = step[dof(mobility) - 1], turn2 = turn * turn;
    result.theta += turn;
    if (turn2 < 1e-4) {  // the series is exact to rounding and several times faster
      const Real s = turn * (1 - turn2 * (1.0 / 6 - turn2 / 120));
      const Real c = 1 - turn2 * (0.5 - turn2 * (1.0 / 24 - turn2 / 720));
      const Real x = pose.R(0, 0), y = pose.R(1, 0);
      result.R(0, 0) = result.R(1, 1) = c * x - s * y;
      result.R(1, 0) = s * x + c * y;
      result.R(0, 1) = -result.R(1, 0);
    } else {
      result.R = rotation_z(result.theta);
    }
  }
  return result;
}

Coordinates difference(Mobility mobility, const Pose& to, const Pose& from) {
  if (mobility == Mobility::spatial) {
    const Vec3 d = to.D - from.D, w = log_so3(to.R * from.R.transpose());
    return {d.x(), d.y(), d.z(), w.x(), w.y(), w.z()};
  }
  Coordinates step = to_coordinates(mobility, to);
  const Coordinates start = to_coordinates(mobility, from);
  for (int i : range(dof(mobility))) step[i] -= start[i];
  return step;
}

void carry(const Robot& robot, const Pose& pose, Carried& carried) {
  const int n = carried.n = dof(robot.mobility);
  carried.mobility = robot.mobility;
  carried.pose = pose;
  if (!is_rotational(robot.mobility)) return;
  std::array<Vec3, kMaxAxes> centre;
  Vec3 p;
  Mat3 R;
  for (int j : range(n)) {
    const PassiveAxis& axis = robot.axis[j];
    const Mat3 turn = turn_about(axis.direction, cos(pose.D[j]), sin(pose.D[j]));
    const bool first = j == 0;  // R is the identity
    centre[j] = p = first ? axis.origin : p + R * axis.origin;
    carried.axis[j] = first ? axis.direction : R * axis.direction;
    R = first ? turn : R * turn;
  }
  carried.pose.D = p;
  carried.pose.R = R;
  for (int j : range(n)) {
    carried.arm[j] = p - centre[j];
    carried.linear[j] = carried.axis[j].cross(carried.arm[j]);
  }
}

Twist to_twist(const Carried& carried, const Coordinates& rate) {
  Twist twist;
  for (int j : range(carried.n)) {
    if (is_rotational(carried.mobility)) {
      twist.velocity += rate[j] * carried.linear[j];
      twist.omega += rate[j] * carried.axis[j];
    } else if (const int column = free_columns(carried.mobility)[j]; column < 3) {
      twist.velocity[column] = rate[j];
    } else {
      twist.omega[column - 3] = rate[j];
    }
  }
  return twist;
}
}  // namespace truepose
