// Where is the nacelle? Coordinates x, pose (D, R) and the twists that the mobility leaves free.
#pragma once

#include "truepose/math/lanes.hpp"

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

inline Mat3 rotation_z(double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  Mat3 R;
  R << c, -s, 0, s, c, 0, 0, 0, 1;
  return R;
}

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

/// sin(θ)/θ and (1 - cos θ)/θ², side by side, from θ². Up to 1 rad by their series, which are exact
/// to rounding, need no root and cost a third of sine and cosine.
inline Pair versine_ratios(double angle2) {
  if (!(angle2 < 1)) {
    const double angle = std::sqrt(angle2);
    return {std::sin(angle) / angle, (1 - std::cos(angle)) / angle2};
  }
  // (-θ²)ᵏ/(2k+1)! and (-θ²)ᵏ/(2k+2)!, k = 0 … 8, even and odd powers apart to shorten the chain.
  const double t = angle2, t2 = t * t, t4 = t2 * t2;
  const auto term = [](double first, double second) -> Pair { return {1 / first, 1 / second}; };
  const Pair low = (term(1, 2) - t * term(6, 24)) + t2 * (term(120, 720) - t * term(5040, 40320));
  const Pair high = (term(362880, 3628800) - t * term(39916800, 479001600)) +
                    t2 * (term(6227020800, 87178291200) - t * term(1307674368000, 20922789888000));
  return low + t4 * (high + t4 * term(355687428096000, 6402373705728000));
}

/// Rotation by the vector w (Rodrigues): I + a W + b W², W² = w wᵀ - |w|² I.
inline Mat3 exp_so3(const Vec3& w) {
  const double angle2 = w.squaredNorm();
  const Pair ratios = versine_ratios(angle2);
  const double a = ratios[0], b = ratios[1], c = 1 - b * angle2;
  const Vec3 s = a * w, u = b * w;
  const double xy = u.x() * w.y(), xz = u.x() * w.z(), yz = u.y() * w.z();
  Mat3 R;
  R << c + u.x() * w.x(), xy - s.z(), xz + s.y(), xy + s.z(), c + u.y() * w.y(), yz - s.x(),
      xz - s.y(), yz + s.x(), c + u.z() * w.z();
  return R;
}

/// Rotation vector of R, angle in [0, π]. Through the quaternion: well conditioned everywhere.
inline Vec3 log_so3(const Mat3& R) {
  Eigen::Quaterniond quaternion(R);
  if (quaternion.w() < 0) quaternion.coeffs() = -quaternion.coeffs();
  const double s = quaternion.vec().norm();
  const double c = quaternion.w();
  const double half = c > 0.1 ? std::atan(s / c) : std::atan2(s, c);  // atan: half the cost
  return (s < 1e-10 ? 2.0 : 2.0 * half / s) * quaternion.vec();
}

/// θ next to `near`, turns and all, from R. Beyond 1000 rad the turns would cost θ its last digits
/// (1e-13 rad): they are given up.
inline double theta_of(const Mat3& R, double near) {
  const double theta = std::atan2(R(1, 0), R(0, 0));
  if (!(std::fabs(near) < 1000)) return theta;
  return theta + 2 * M_PI * std::nearbyint((near - theta) / (2 * M_PI));
}

template <Mobility K>
inline Pose to_pose(const Joint& x) {
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
inline Joint to_coordinates(const Pose& pose) {
  Joint x{};
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
inline Pose moved(const Pose& pose, const Joint& step) {
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
inline Joint difference(const Pose& to, const Pose& from) {
  if constexpr (K == Mobility::spatial) {
    const Vec3 d = to.D - from.D, w = log_so3(to.R * from.R.transpose());
    return {d.x(), d.y(), d.z(), w.x(), w.y(), w.z()};
  } else {
    Joint step = to_coordinates<K>(to);
    const Joint start = to_coordinates<K>(from);
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
inline Twist to_twist(const Joint& rate) {
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
inline Pose to_pose(Mobility mobility, const Joint& x) {
  return with_mobility(mobility, [&](auto K) { return to_pose<K()>(x); });
}
inline Joint to_coordinates(Mobility mobility, const Pose& pose) {
  return with_mobility(mobility, [&](auto K) { return to_coordinates<K()>(pose); });
}
inline Pose moved(Mobility mobility, const Pose& pose, const Joint& step) {
  return with_mobility(mobility, [&](auto K) { return moved<K()>(pose, step); });
}
inline void free_columns(Mobility mobility, const Vec3& linear, const Vec3& angular, double* row) {
  with_mobility(mobility, [&](auto K) { free_columns<K()>(linear, angular, row); });
}

}  // namespace truepose
