// Coordinates x, poses (D, R) and the free twists of a mobility.
#pragma once

#include <cassert>

#include "truepose/math/so3.hpp"

namespace truepose {
/// Position D of the platform's reference point and orientation R (platform to base). theta keeps
/// its turns, unlike R. On passive axes D holds x, their angles; carried_frames() gives the true D
/// and R.
struct Pose {
  Vec3 D = Vec3::Zero();
  Mat3 R = Mat3::Identity();
  Real theta = 0;
};

inline constexpr std::array<std::array<int, kMaxDof>, 5> kFreeColumns{
    {{0, 1}, {0, 1, 5}, {0, 1, 2}, {0, 1, 2, 5}, {0, 1, 2, 3, 4, 5}}};

/// Number of position coordinates without passive axes.
constexpr int positions_of(Mobility mobility) {
  return mobility == Mobility::planar || mobility == Mobility::planar_translation ? 2 : 3;
}

/// The free columns of the 6-twist [velocity of D; angular velocity], base frame.
template <Mobility K>
struct Freedom {
  static constexpr std::array<int, kMaxDof> columns = kFreeColumns[static_cast<std::size_t>(K)];
};

template <Mobility K>
inline constexpr int kDof = dof(K);
template <Mobility K>
inline constexpr bool kRotational = is_rotational(K);
template <Mobility K>
inline constexpr bool kTurnsAboutZ = K == Mobility::planar || K == Mobility::schoenflies;

/// Number of coordinates that D holds, which come first.
template <Mobility K>
inline constexpr int kPositions = kRotational<K> ? kDof<K> : positions_of(K);

/// R l for each of N vectors, without products that are zero for the mobility.
template <Mobility K, int N>
inline Points<N> turned(const Mat3& R, const Points<N>& l) {
  if constexpr (K == Mobility::spatial || kRotational<K>)
    return {R(0, 0) * l.px + R(0, 1) * l.py + R(0, 2) * l.pz,
            R(1, 0) * l.px + R(1, 1) * l.py + R(1, 2) * l.pz,
            R(2, 0) * l.px + R(2, 1) * l.py + R(2, 2) * l.pz};
  else if constexpr (kTurnsAboutZ<K>)
    return {R(0, 0) * l.px + R(0, 1) * l.py, R(1, 0) * l.px + R(1, 1) * l.py, l.pz};
  else
    return l;
}

/// R l, without products that are zero for the mobility.
template <Mobility K>
inline Vec3 turned(const Mat3& R, const Vec3& l) {
  if constexpr (K == Mobility::spatial || kRotational<K>)
    return R * l;
  else if constexpr (kTurnsAboutZ<K>)
    return Vec3(R(0, 0) * l.x() + R(0, 1) * l.y(), R(1, 0) * l.x() + R(1, 1) * l.y(), l.z());
  else
    return l;
}

template <Mobility K>
inline Pose to_pose(const Coordinates& x) {
  Pose pose;
  for (int j = 0; j < kPositions<K>; ++j) pose.D[j] = x[j];
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
  for (int j = 0; j < kPositions<K>; ++j) x[j] = pose.D[j];
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
  Pose result = pose;
  for (int j = 0; j < kPositions<K>; ++j) result.D[j] += step[j];
  if constexpr (K == Mobility::spatial)
    result.R = exp_so3(Vec3(step[3], step[4], step[5])) * pose.R;
  if constexpr (kTurnsAboutZ<K>) {
    const Real turn = step[kDof<K> - 1], turn2 = turn * turn;
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

/// Position and orientation that the passive axes give the platform, and each axis' twist: a turn
/// about a_j through p_j moves D with a_j × (D - p_j).
template <Mobility K>
struct CarriedByAxes {
  Pose pose;                               ///< D and R of the platform
  std::array<Vec3, kDof<K>> axis, linear;  ///< a_j, and the velocity of D at ẋ_j = 1, base frame
  std::array<Vec3, kDof<K>> arm;           ///< D - p_j
};
/// Empty for other mobilities, whose pose is complete.
struct NotCarried {};
/// The data of passive axes, where the mobility has them.
template <Mobility K>
using Carried = std::conditional_t<kRotational<K>, CarriedByAxes<K>, NotCarried>;

/// cos x and sin x of an angle.
inline void turn_to(Real angle, Real& cosine, Real& sine) {
  cosine = std::cos(angle);
  sine = std::sin(angle);
}

/// The same after a turn by t to `angle`. Small t: a series, exact to rounding, 3× as fast.
inline void turn_by(Real t, Real angle, Real& cosine, Real& sine) {
  const Real t2 = t * t;
  if (!(t2 < 1e-3)) return turn_to(angle, cosine, sine);
  // The omitted terms, t⁹/9! and t⁸/8!, are below 3e-17 of t and of 1.
  const Real s = t * (1 - t2 * (1.0 / 6 - t2 * (1.0 / 120 - t2 * (1.0 / 5040))));
  const Real c = 1 - t2 * (0.5 - t2 * (1.0 / 24 - t2 * (1.0 / 720)));
  const Real before = cosine;
  cosine = c * before - s * sine;
  sine = s * before + c * sine;
}

/// Evaluates the chain of frames: p_j = p_{j-1} + R o_j, a_j = R d_j, R ← R exp(x_j d_j); the
/// platform is on the last axis, D = p_n. @param cosine, sine  of x_j
template <Mobility K>
  requires kRotational<K>
TRUEPOSE_FLATTEN inline Carried<K> carried_frames(const Robot& robot,
                                                  const std::array<Real, kDof<K>>& cosine,
                                                  const std::array<Real, kDof<K>>& sine) {
  constexpr int n = kDof<K>;
  Carried<K> carried;
  std::array<Vec3, n> centre;
  Mat3 R = turn_about(robot.axis[0].direction(), cosine[0], sine[0]);
  carried.axis[0] = robot.axis[0].direction();
  centre[0] = robot.axis[0].origin();
  for (int j = 1; j < n; ++j) {
    const Vec3 d = robot.axis[j].direction(), o = robot.axis[j].origin();
    centre[j] = centre[j - 1] + R * o;
    carried.axis[j] = R * d;
    const Mat3 turn = turn_about(d, cosine[j], sine[j]), before = R;
    for (int k = 0; k < 3; ++k)
      R.col(k) =
          turn(0, k) * before.col(0) + turn(1, k) * before.col(1) + turn(2, k) * before.col(2);
  }
  carried.pose.D = centre[n - 1];
  carried.pose.R = R;
  for (int j = 0; j < n; ++j) {
    carried.arm[j] = carried.pose.D - centre[j];
    carried.linear[j] = carried.axis[j].cross(carried.arm[j]);
  }
  return carried;
}
template <Mobility K>
inline Carried<K> carried_frames([[maybe_unused]] const Robot& robot,
                                 [[maybe_unused]] const Pose& pose) {
  if constexpr (kRotational<K>) {
    std::array<Real, kDof<K>> cosine, sine;
    for (int j = 0; j < kDof<K>; ++j) turn_to(pose.D[j], cosine[j], sine[j]);
    return carried_frames<K>(robot, cosine, sine);
  } else {
    return {};
  }
}

/// D and R of the platform.
template <Mobility K>
inline const Pose& placed(const Pose& pose, [[maybe_unused]] const Carried<K>& carried) {
  if constexpr (kRotational<K>)
    return carried.pose;
  else
    return pose;
}
template <Mobility K>
inline Pose placed(const Robot& robot, const Pose& pose) {
  return placed<K>(pose, carried_frames<K>(robot, pose));
}

/// Velocity of D and angular velocity, base frame.
struct Twist {
  Vec3 velocity = Vec3::Zero();
  Vec3 omega = Vec3::Zero();
};
template <Mobility K>
inline Twist to_twist([[maybe_unused]] const Carried<K>& carried, const Coordinates& rate) {
  if constexpr (kRotational<K>) {
    Twist twist;
    for (int j = 0; j < kDof<K>; ++j) {
      twist.velocity += rate[j] * carried.linear[j];
      twist.omega += rate[j] * carried.axis[j];
    }
    return twist;
  } else {
    std::array<Real, 6> full{};
    for (int j = 0; j < kDof<K>; ++j) full[Freedom<K>::columns[j]] = rate[j];
    return {Vec3(full[0], full[1], full[2]), Vec3(full[3], full[4], full[5])};
  }
}

/// The row [linear, angular] T along the platform's free twists.
template <Mobility K>
inline void free_columns([[maybe_unused]] const Carried<K>& carried, const Vec3& linear,
                         const Vec3& angular, Real* row) {
  for (int j = 0; j < kDof<K>; ++j)
    if constexpr (kRotational<K>) {
      row[j] = linear.dot(carried.linear[j]) + angular.dot(carried.axis[j]);
    } else {
      const int column = Freedom<K>::columns[j];
      row[j] = column < 3 ? linear[column] : angular[column - 3];
    }
}

// The same with the mobility as a run-time value, for offline code written once.

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
/// (Not for rotational platforms, whose columns depend on the pose.)
inline void free_columns(Mobility mobility, const Vec3& linear, const Vec3& angular, Real* row) {
  assert(!is_rotational(mobility));
  with_mobility(mobility, [&](auto K) {
    if constexpr (!kRotational<K()>) free_columns<K()>({}, linear, angular, row);
  });
}
}  // namespace truepose
