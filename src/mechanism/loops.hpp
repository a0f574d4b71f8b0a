// Loop-closure residuals with the motors held, and their derivatives by the platform's motion.
#pragma once

#include <tuple>

#include "mechanism/jacobian.hpp"

namespace truepose {
/// f_i = (|v_i|² - L_i²)/2, zero where chain i closes; derivative -J_x in the pose's tangent space.
struct Loops {
  Pose pose;
  Carried carried;
  std::array<Vec3, kMaxChains> lever, v;  ///< R c, A to B
  Joint f;
  Real cost, residual;  ///< Σf², largest closure error (m)

  /// Places the platform and evaluates the loops. @param driven  the motors' points
  void place(const Robot& robot, const std::array<Driven, kMaxChains>& driven, const Pose& at) {
    pose = at;
    carry(robot, at, carried);
    cost = residual = 0;
    for (int i = 0; i < robot.motors; ++i) {
      const Chain& chain = robot.chain[i];
      const Real rod = driven[i].rod;
      lever[i] = carried.pose.R * chain.pivot;
      v[i] = chain.base + driven[i].p - carried.pose.D - lever[i] - chain.anchor;
      f[i] = 0.5 * (v[i].squaredNorm() - rod * rod);
      cost += f[i] * f[i];
      residual = std::max(residual, std::fabs(f[i]) / rod);  // |v| - L = f / L to first order
    }
  }
  /// -∂f/∂x. @return the sizes of its columns
  Unknowns jx(int motors, Square& rows) const {
    return jx_rows(carried, motors, rows, [&](int i) { return std::tie(v[i], lever[i]); });
  }
};
}  // namespace truepose
