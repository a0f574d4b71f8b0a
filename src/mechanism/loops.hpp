// Loop-closure residuals with the motors held.
#pragma once

#include "mechanism/jacobian.hpp"

namespace truepose {
/// Loops that may be open: f_i = (|v_i|² - L_i²)/2, zero where chain i closes; derivative -J_x in
/// the pose's tangent space.
struct Loops : Closure {
  Joint f;
  Real cost, residual;  ///< Σf², largest closure error (m)

  /// Places the platform and evaluates the loops. @param driven  the motors' points
  void place(const Robot& robot, const std::array<Driven, kMaxChains>& driven, const Pose& at) {
    pose = at;
    motors = robot.motors;
    carry(robot, at, carried);
    cost = residual = 0;
    for (int i : range(motors)) {
      const Chain& of = robot.chain[i];
      const Real rod = driven[i].rod;
      Vec3 &lever = chain[i].lever, &v = chain[i].v;
      lever = placed().R * of.pivot;
      v = of.base + driven[i].p - placed().D - lever - of.anchor;
      f[i] = 0.5 * (v.squaredNorm() - rod * rod);
      cost += f[i] * f[i];
      residual = max(residual, fabs(f[i]) / rod);  // |v| - L = f / L to first order
    }
  }
};
}  // namespace truepose
