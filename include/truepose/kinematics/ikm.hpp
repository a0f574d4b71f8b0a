// The inverse kinematic model (IKM).
#pragma once

#include "truepose/model/chain.hpp"

namespace truepose {
/// A mechanism with all its loops closed, from which every Jacobian is computed.
template <Mobility K>
struct Closure {
  Pose pose;
  std::array<ChainState, kDof<K>> chain;
  [[no_unique_address]] Carried<K> carried;

  /// D and R of the platform.
  const Pose& placed() const { return truepose::placed<K>(pose, carried); }

  Joint q() const {
    Joint values{};
    for (int i = 0; i < kDof<K>; ++i) values[i] = chain[i].q;
    return values;
  }
};

/// Closes every chain at the pose, each in its own working mode.
/// @return unreachable and the first chain that cannot close, or not_finite.
template <Mobility K, bool NeedAngle = true>
TRUEPOSE_FLATTEN inline Outcome ikm(const Robot& robot, const Pose& pose, Closure<K>& closure) {
  if (!robot.finished) return {Status::unfinished, -1};
  constexpr int n = kDof<K>;
  closure.pose = pose;
  closure.carried = carried_frames<K>(robot, pose);
  const Vec3& D = closure.placed().D;
  const auto lever = turned<K>(closure.placed().R,
                               points<n>([&](int i) -> Vec3 { return robot.chain[i].pivot(); }));
  const auto offset =
      points<n>([&](int i) -> Vec3 { return robot.chain[i].anchor() - robot.chain[i].base(); });
  const Points<n> d{D.x() + lever.px + offset.px, D.y() + lever.py + offset.py,
                    D.z() + lever.pz + offset.pz};
  const Lanes<n> d2 = d.squared_norm();
  Real sum = 0;  // not finite after a NaN or an overflow
  for (int i = 0; i < n; ++i) {
    closure.chain[i].lever = lever[i];
    if (!close<NeedAngle>(robot.chain[i], d[i], d2[i], closure.chain[i])) {
      const bool finite = pose.D.allFinite() && pose.R.allFinite();
      return {finite ? Status::unreachable : Status::not_finite, i};
    }
    if constexpr (NeedAngle) sum += closure.chain[i].q;
  }
  return {std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}

/// q = IKM(x) for coordinates x of any mobility.
/// @return joint_limit where a motor is beyond its stops (`q` then says how far)
inline Outcome ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return with_mobility(robot.mobility, [&]<Mobility K>(Fixed<K>) {
    Closure<K> closure;
    const Outcome outcome = ikm<K>(robot, to_pose<K>(x), closure);
    if (!outcome) return outcome;
    q = closure.q();
    return within_limits<K>(robot, closure.pose, q);
  });
}
}  // namespace truepose
