// The inverse kinematic model (IKM): motor positions from a pose.
#pragma once

#include "mechanism/chain.hpp"

namespace truepose {
/// All loops of the mechanism at one pose.
struct Closure {
  Pose pose;
  Carried carried;
  int motors = 0;
  std::array<ChainState, kMaxChains> chain;

  /// D and R of the platform.
  const Pose& placed() const { return carried.pose; }
  Joint q() const {
    Joint values{};
    for (int i : range(motors)) values[i] = chain[i].q;
    return values;
  }
};

/// Closes all loops at a pose. The joint positions are the encoders' readings.
/// @param angle  false: q is left out, which needs no trigonometry
/// @return unreachable and the first chain that cannot close, or not_finite.
inline Outcome ikm(const Robot& robot, const Pose& pose, Closure& closure, bool angle = true) {
  if (!robot.finished) return {Status::unfinished};
  if (is_mechanism(robot.mobility)) return {Status::no_chains};
  closure.pose = pose;
  closure.motors = robot.motors;
  carry(robot, pose, closure.carried);
  const Pose& at = closure.placed();
  Real sum = 0;  // not finite after a NaN or an overflow
  for (int i : range(robot.motors)) {
    const Chain& chain = robot.chain[i];
    ChainState& state = closure.chain[i];
    state.lever = at.R * chain.pivot;
    if (!close(chain, at.D + state.lever + chain.anchor - chain.base, angle, state)) {
      const bool finite = pose.D.allFinite() && pose.R.allFinite();
      return {finite ? Status::unreachable : Status::not_finite, i};
    }
    if (angle) sum += state.q;
  }
  return {isfinite(sum) ? Status::ok : Status::not_finite};
}
}  // namespace truepose
