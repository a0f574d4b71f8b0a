// Coordinates x, poses (D, R) and the free twists of a mobility.
#pragma once

#include "math/so3.hpp"
#include "mechanism/robot.hpp"

namespace truepose {
/// Position D of the platform's reference point and orientation R (platform to base). theta keeps
/// its turns, unlike R. On passive axes D holds x, their angles; carried_frames() gives the true D
/// and R. Of a mechanism D holds x, R is the platform's.
struct Pose {
  Vec3 D = Vec3::Zero();
  Mat3 R = Mat3::Identity();
  Real theta = 0;
};

/// The free columns of the 6-twist [velocity of D; angular velocity], base frame, of a mobility
/// without passive axes.
inline constexpr std::array<std::array<int, kMaxDof>, 5> kFreeColumns{
    {{0, 1}, {0, 1, 5}, {0, 1, 2}, {0, 1, 2, 5}, {0, 1, 2, 3, 4, 5}}};
constexpr const std::array<int, kMaxDof>& free_columns(Mobility mobility) {
  return kFreeColumns[std::size_t(mobility)];
}

/// Whether θ, a turn about z, is the last coordinate.
constexpr bool turns_about_z(Mobility mobility) {
  return mobility == Mobility::planar || mobility == Mobility::schoenflies;
}

/// Number of coordinates that D holds, which come first.
constexpr int positions_of(Mobility mobility) {
  if (mobility >= Mobility::rotational_1) return dof(mobility);
  return mobility == Mobility::planar || mobility == Mobility::planar_translation ? 2 : 3;
}

Pose to_pose(Mobility mobility, const Coordinates& x);

Coordinates to_coordinates(Mobility mobility, const Pose& pose);

/// The pose after the small motion `step` (size n, free columns of the twist): D + v, exp(ω) R.
Pose moved(Mobility mobility, const Pose& pose, const Coordinates& step);

/// The small motion that takes `from` to `to`: the inverse of moved().
Coordinates difference(Mobility mobility, const Pose& to, const Pose& from);

/// Position and orientation of the platform, and its free twists. On passive axes a turn about a_j
/// through p_j moves D with a_j × (D - p_j).
struct Carried {
  Mobility mobility;
  int n;
  Pose pose;                                ///< D and R of the platform
  std::array<Vec3, kMaxAxes> axis, linear;  ///< a_j, and the velocity of D at ẋ_j = 1, base frame
  std::array<Vec3, kMaxAxes> arm;           ///< D - p_j
};

/// Evaluates the chain of frames: p_j = p_{j-1} + R o_j, a_j = R d_j, R ← R exp(x_j d_j); the
/// platform is on the last axis, D = p_n. Without passive axes the pose is the platform's.
void carry(const Robot& robot, const Pose& pose, Carried& carried);
inline Carried carried_frames(const Robot& robot, const Pose& pose) {
  Carried carried;
  carry(robot, pose, carried);
  return carried;
}

/// D and R of the platform.
inline Pose placed(const Robot& robot, const Pose& pose) {
  return carried_frames(robot, pose).pose;
}

/// Velocity of D and angular velocity, base frame.
struct Twist {
  Vec3 velocity = Vec3::Zero();
  Vec3 omega = Vec3::Zero();
};
Twist to_twist(const Carried& carried, const Coordinates& rate);

/// The row [linear, angular] itself: along all six twists.
inline void twist_row(const Vec3& linear, const Vec3& angular, Real* row) {
  copy_first(3, linear, row);
  copy_first(3, angular, row + 3);
}

/// The row [linear, angular] T along the platform's free twists.
inline void free_row(const Carried& carried, const Vec3& linear, const Vec3& angular, Real* row) {
  if (is_rotational(carried.mobility)) {
    for (int j : range(carried.n))
      row[j] = linear.dot(carried.linear[j]) + angular.dot(carried.axis[j]);
    return;
  }
  Real twist[6];
  twist_row(linear, angular, twist);
  const auto& column = free_columns(carried.mobility);
  for (int j : range(carried.n)) row[j] = twist[column[j]];
}
}  // namespace truepose
