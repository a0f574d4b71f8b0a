// Where is the nacelle? Coordinates x, pose (D, R) and the twists that the mobility leaves free.
#pragma once

#include "truepose/math/so3.hpp"

namespace truepose {

/// Position D of the nacelle's reference point and orientation R (nacelle to base).
/// theta keeps its turns, which R alone cannot.
struct Pose {
  Vec3 D = Vec3::Zero();
  Mat3 R = Mat3::Identity();
  double theta = 0;
};

/// The columns of the 6-twist [velocity of D; angular velocity], base frame, that are free.
template <Mobility K>
struct Freedom;
template <>
struct Freedom<Mobility::planar_translation> {
  static constexpr std::array<int, 2> columns{0, 1};
};
template <>
struct Freedom<Mobility::planar> {
  static constexpr std::array<int, 3> columns{0, 1, 5};
};
template <>
struct Freedom<Mobility::translation> {
  static constexpr std::array<int, 3> columns{0, 1, 2};
};
template <>
struct Freedom<Mobility::schoenflies> {
  static constexpr std::array<int, 4> columns{0, 1, 2, 5};
};
template <>
struct Freedom<Mobility::spatial> {
  static constexpr std::array<int, 6> columns{0, 1, 2, 3, 4, 5};
};

template <Mobility K>
inline constexpr int kDof = dof(K);
template <Mobility K>
inline constexpr bool kTurnsAboutZ = K == Mobility::planar || K == Mobility::schoenflies;

/// R l, by as many products as the mobility needs, for each of N vectors.
template <Mobility K, int N>
inline Points<N> turned(const Mat3& R, const Points<N>& l) {
  if constexpr (K == Mobility::spatial)
    return {R(0, 0) * l.px + R(0, 1) * l.py + R(0, 2) * l.pz,
            R(1, 0) * l.px + R(1, 1) * l.py + R(1, 2) * l.pz,
            R(2, 0) * l.px + R(2, 1) * l.py + R(2, 2) * l.pz};
  else if constexpr (kTurnsAboutZ<K>)
    return {R(0, 0) * l.px + R(0, 1) * l.py, R(1, 0) * l.px + R(1, 1) * l.py, l.pz};
  else
    return l;
}

/// R l, by as many products as the mobility needs.
template <Mobility K>
inline Vec3 turned(const Mat3& R, const Vec3& l) {
  if constexpr (K == Mobility::spatial)
    return R * l;
  else if constexpr (kTurnsAboutZ<K>)
    return Vec3(R(0, 0) * l.x() + R(0, 1) * l.y(), R(1, 0) * l.x() + R(1, 1) * l.y(), l.z());
  else
    return l;
}

template <Mobility K>
inline Pose to_pose(const Coordinates& x) {
  Pose pose;
  pose.D.x() = x[0];
  pose.D.y() = x[1];
  if constexpr (K == Mobility::translation || K == Mobility::schoenflies || K == Mobility::spatial)
    pose.D.z() = x[2];
  if constexpr (kTurnsAboutZ<K>) {
    pose.theta = x[kDof<K> - 1];
    pose.R = rotation_z(pose.theta);
  }
  if constexpr (K == Mobility::spatial) pose.R = exp_so3(Vec3(x[3], x[4], x[5]));
  return pose;
}

template <Mobility K>
inline Coordinates to_coordinates(const Pose& pose) {
  Coordinates x{};
  x[0] = pose.D.x();
  x[1] = pose.D.y();
  if constexpr (K == Mobility::translation || K == Mobility::schoenflies || K == Mobility::spatial)
    x[2] = pose.D.z();
  if constexpr (kTurnsAboutZ<K>) x[kDof<K> - 1] = pose.theta;
  if constexpr (K == Mobility::spatial) {
    const Vec3 w = log_so3(pose.R);
    for (int i = 0; i < 3; ++i) x[3 + i] = w[i];
  }
  return x;
}

/// The pose after the small motion `step` (size n, free columns of the twist): D + v, exp(ω) R.
template <Mobility K>
inline Pose moved(const Pose& pose, const Coordinates& step) {
  if constexpr (K == Mobility::spatial) {
    Pose result;
    result.D = pose.D + Vec3(step[0], step[1], step[2]);
    result.R = exp_so3(Vec3(step[3], step[4], step[5])) * pose.R;
    return result;
  } else {
    Pose result = pose;
    result.D.x() += step[0];
    result.D.y() += step[1];
    if constexpr (K == Mobility::translation || K == Mobility::schoenflies) result.D.z() += step[2];
    if constexpr (kTurnsAboutZ<K>) {
      const double turn = step[kDof<K> - 1], turn2 = turn * turn;
      result.theta += turn;
      if (turn2 < 1e-4) {  // the series is exact to rounding, and several times faster
        const double s = turn * (1 - turn2 * (1.0 / 6 - turn2 / 120));
        const double c = 1 - turn2 * (0.5 - turn2 * (1.0 / 24 - turn2 / 720));
        const double x = pose.R(0, 0), y = pose.R(1, 0);
        result.R(0, 0) = result.R(1, 1) = c * x - s * y;
        result.R(1, 0) = s * x + c * y;
        result.R(0, 1) = -result.R(1, 0);
      } else {
        result.R = rotation_z(result.theta);
      }
    }
    return result;
  }
}

/// The small motion that takes `from` to `to`: the inverse of moved().
template <Mobility K>
inline Coordinates difference(const Pose& to, const Pose& from) {
  if constexpr (K == Mobility::spatial) {
    const Vec3 d = to.D - from.D, w = log_so3(to.R * from.R.transpose());
    return {d.x(), d.y(), d.z(), w.x(), w.y(), w.z()};
  } else {
    Coordinates step = to_coordinates<K>(to);
    const Coordinates start = to_coordinates<K>(from);
    for (int i = 0; i < kDof<K>; ++i) step[i] -= start[i];
    return step;
  }
}

/// Velocity of D and angular velocity (base frame) of a twist given by its free columns.
struct Twist {
  Vec3 velocity = Vec3::Zero();
  Vec3 omega = Vec3::Zero();
};
template <Mobility K>
inline Twist to_twist(const Coordinates& rate) {
  std::array<double, 6> full{};
  for (int j = 0; j < kDof<K>; ++j) full[Freedom<K>::columns[j]] = rate[j];
  return {Vec3(full[0], full[1], full[2]), Vec3(full[3], full[4], full[5])};
}

/// The free columns of the row [linear, angular].
template <Mobility K>
inline void free_columns(const Vec3& linear, const Vec3& angular, double* row) {
  for (int j = 0; j < kDof<K>; ++j) {
    const int column = Freedom<K>::columns[j];
    row[j] = column < 3 ? linear[column] : angular[column - 3];
  }
}

// The same of a mobility that is a number: offline work, written once, calls these.

constexpr bool turns_about_z(Mobility mobility) {
  return mobility == Mobility::planar || mobility == Mobility::schoenflies;
}
inline Pose to_pose(Mobility mobility, const Coordinates& x) {
  return with_mobility(mobility, [&](auto K) { return to_pose<K()>(x); });
}
inline Coordinates to_coordinates(Mobility mobility, const Pose& pose) {
  return with_mobility(mobility, [&](auto K) { return to_coordinates<K()>(pose); });
}
inline Pose moved(Mobility mobility, const Pose& pose, const Coordinates& step) {
  return with_mobility(mobility, [&](auto K) { return moved<K()>(pose, step); });
}
inline void free_columns(Mobility mobility, const Vec3& linear, const Vec3& angular, double* row) {
  with_mobility(mobility, [&](auto K) { free_columns<K()>(linear, angular, row); });
}

}  // namespace truepose
