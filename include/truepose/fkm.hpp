// Where is the nacelle, from the motors alone? The forward kinematic model (FKM), by Newton.
#pragma once

#include "truepose/jacobian.hpp"

namespace truepose {

inline constexpr int kFkmIterations = 60;

struct FkmResult {
  Status status = Status::ok;
  int chain = -1;       ///< the chain at fault, if one is
  int iterations = 0;   ///< steps tried, at most kFkmIterations
  double residual = 0;  ///< largest closure error | |v_i| - L_i |, m
  explicit operator bool() const { return status == Status::ok; }
};

/// Newton on f_i = (|v_i|² - L_i²)/2, whose derivative with respect to the pose is -J_x, in the
/// tangent space of the pose (no Euler angles). A step that does not lower Σf² is retried with
/// Levenberg's damping. Convergence is judged by the residual, to rounding.
///
/// @param pose  in: the guess; out: the pose (the last iterate if not ok)
template <Mobility K>
TRUEPOSE_FLATTEN FkmResult fkm(const Robot& robot, const Joint& q, Pose& pose) {
  constexpr int n = kDof<K>;
  FkmResult result;
  std::array<Driven, n> driven;
  for (int i = 0; i < n; ++i) {
    driven[i] = drive(robot.chain[i], q[i]);
    if (!std::isfinite(q[i])) return {Status::not_finite, i, 0, 0};
    if (!(driven[i].rod > 0)) return {Status::unreachable, i, 0, 0};  // a telescopic leg
  }
  const auto pivot = points<n>([&](int i) -> const Vec3& { return robot.chain[i].pivot; });
  const auto centre = points<n>([&](int i) -> Vec3 {  // of the sphere on which D + R c lies
    return robot.chain[i].base + driven[i].p - robot.chain[i].anchor;
  });
  const auto rod = lanes<n>([&](int i) { return driven[i].rod; });
  const Lanes<n> half_rod2 = 0.5 * rod * rod, per_rod = 1 / rod;
  const double scale = largest<n>(rod);

  struct Iterate {
    Pose pose;
    Points<n> lever, v;
    Lanes<n> f;
    double cost, residual;
  };
  const auto evaluate = [&](Iterate& at) {
    at.lever = turned<K>(at.pose.R, pivot);
    const Vec3& D = at.pose.D;
    at.v = {centre.px - D.x() - at.lever.px, centre.py - D.y() - at.lever.py,
            centre.pz - D.z() - at.lever.pz};
    at.f = 0.5 * at.v.squared_norm() - half_rod2;
    at.cost = (at.f * at.f).sum();
    at.residual = largest<n>(at.f.abs() * per_rod);  // |v| - L = f / L to first order
  };

  const double rounding = 2e-15 * scale;
  std::array<Iterate, 2> iterates;
  Iterate *current = &iterates[0], *trial = &iterates[1];
  current->pose = pose;
  evaluate(*current);
  if (!std::isfinite(current->cost)) return {Status::not_finite, -1, 0, 0};

  std::array<Lanes<n>, n> jx;  // columns of J_x
  Matrix<n, n> inverse;
  double damping = 0;
  bool regular = true;
  do {
    jx_row<K>(current->v, current->lever, jx);
    const auto sizes = column_sizes<K>(current->v.squared_norm(), current->lever);
    regular = invert<n>(jx, sizes, Lanes<n>::Ones(), damping, inverse);
    if (!regular) {
      ++result.iterations;
      damping = std::max(10 * damping, 1e-3);
      continue;
    }
    // Near the solution the same factors serve a second, chord step: its error is the product
    // of two small ones, and it costs a third of a new factorisation.
    do {
      ++result.iterations;
      const Lanes<n> step = times<n>(inverse, current->f);
      Joint motion{};
      for (int j = 0; j < n; ++j) motion[j] = step[j];
      trial->pose = moved<K>(current->pose, motion);
      evaluate(*trial);
      if (!(trial->cost < current->cost)) {
        damping = std::max(10 * damping, 1e-3);
        break;
      }
      damping = damping > 1e-3 ? 0.1 * damping : 0;
      std::swap(current, trial);
    } while (damping == 0 && current->residual > rounding && current->residual < 1e-9 * scale &&
             result.iterations < kFkmIterations);
    // A step refused at the level of rounding is not a failure: nothing is left to gain.
    if (current->residual <= rounding || (damping > 0 && current->residual < 1e-13 * scale)) break;
  } while (result.iterations < kFkmIterations && damping < 1e12);

  pose = current->pose;
  if constexpr (kTurnsAboutZ<K>)
    if (std::fabs(pose.theta) > 1000) pose.theta = theta_of(pose.R, pose.theta);
  result.residual = current->residual;
  if (!(current->residual < 1e-12 * scale)) {
    result.status = Status::unreachable;
  } else if (!regular) {
    result.status = Status::singular;
  } else {
    for (int i = 0; i < n; ++i) {
      const Chain& chain = robot.chain[i];
      if (chain.actuator != Actuator::telescopic &&
          jq_entry(chain, current->v[i], driven[i]) * chain.working_mode < 0) {
        result.status = Status::branch_lost;
        result.chain = i;
      }
    }
    jx_row<K>(current->v, current->lever, jx);
    if (robot.assembly_sign != 0 && determinant_sign<n>(jx) != robot.assembly_sign)
      result.status = Status::branch_lost;
  }
  return result;
}

/// x = FKM(q). @param x in: the guess; out: the pose.
inline FkmResult fkm(const Robot& robot, const Joint& q, Joint& x) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Pose pose = to_pose<K>(x);
    const FkmResult result = fkm<K>(robot, q, pose);
    x = to_coordinates<K>(pose);
    return result;
  });
}

}  // namespace truepose
