// Which motor positions hold this pose? The inverse kinematic model (IKM).
#pragma once

#include "truepose/chain.hpp"

namespace truepose {

/// A mechanism with all its loops closed: what every Jacobian is read off.
template <Mobility K>
struct Closure {
  Pose pose;
  std::array<ChainState, kDof<K>> chain;

  Joint q() const {
    Joint values{};
    for (int i = 0; i < kDof<K>; ++i) values[i] = chain[i].q;
    return values;
  }
};

/// Closes every chain on the pose, each in its own working mode.
/// @return unreachable and the first chain that cannot close, or not_finite.
template <Mobility K, bool NeedAngle = true>
TRUEPOSE_FLATTEN inline Outcome ikm(const Robot& robot, const Pose& pose, Closure<K>& closure) {
  constexpr int n = kDof<K>;
  const auto lever =
      turned<K>(pose.R, points<n>([&](int i) -> const Vec3& { return robot.chain[i].pivot; }));
  const auto offset =
      points<n>([&](int i) -> Vec3 { return robot.chain[i].anchor - robot.chain[i].base; });
  const Points<n> d{pose.D.x() + lever.px + offset.px, pose.D.y() + lever.py + offset.py,
                    pose.D.z() + lever.pz + offset.pz};
  const Lanes<n> d2 = d.squared_norm();
  closure.pose = pose;
  for (int i = 0; i < n; ++i) {
    closure.chain[i].lever = lever[i];
    if (!close<NeedAngle>(robot.chain[i], d[i], d2[i], closure.chain[i])) {
      const bool finite = pose.D.allFinite() && pose.R.allFinite();
      return {finite ? Status::unreachable : Status::not_finite, i};
    }
  }
  return {};
}

/// q = IKM(x) for coordinates x of any mobility.
inline Outcome ikm(const Robot& robot, const Joint& x, Joint& q) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Closure<K> closure;
    const Outcome outcome = ikm<K>(robot, to_pose<K>(x), closure);
    if (outcome) q = closure.q();
    return outcome;
  });
}

}  // namespace truepose
