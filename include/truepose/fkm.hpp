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
TRUEPOSE_FLATTEN inline FkmResult fkm(const Robot& robot, const Joint& q, Pose& pose) {
  constexpr int n = kDof<K>;
  FkmResult result;
  std::array<Driven, n> driven;
  std::array<Vec3, n> centre;  // of the sphere on which D + R c lies
  std::array<double, n> per_rod;
  double scale = 0;
  for (int i = 0; i < n; ++i) {
    driven[i] = drive(robot.chain[i], q[i]);
    centre[i] = robot.chain[i].base + driven[i].p - robot.chain[i].anchor;
    per_rod[i] = 1 / driven[i].rod;
    scale = std::max(scale, driven[i].rod);
    if (!std::isfinite(q[i])) return {Status::not_finite, i, 0, 0};
    if (!(driven[i].rod > 0)) return {Status::unreachable, i, 0, 0};  // a telescopic leg
  }

  struct Iterate {
    Pose pose;
    std::array<Vec3, n> lever, v;
    std::array<double, n> f;
    double cost, residual;
  };
  const auto evaluate = [&](Iterate& at) {
    at.cost = at.residual = 0;  // |v| - L = f / L to first order
    for (int i = 0; i < n; ++i) {
      at.lever[i] = turned<K>(at.pose.R, robot.chain[i].pivot);
      at.v[i] = centre[i] - at.pose.D - at.lever[i];
      at.f[i] = 0.5 * (at.v[i].squaredNorm() - driven[i].rod * driven[i].rod);
      at.cost += at.f[i] * at.f[i];
      at.residual = std::max(at.residual, std::fabs(at.f[i]) * per_rod[i]);
    }
  };

  const double rounding = 2e-15 * scale;
  std::array<Iterate, 2> iterates;
  Iterate *current = &iterates[0], *trial = &iterates[1];
  current->pose = pose;
  evaluate(*current);
  if (!std::isfinite(current->cost)) return {Status::not_finite, -1, 0, 0};

  Matrix<n, n> jx;
  double damping = 0;
  bool regular = true;
  do {
    ColumnSizes<K> sizes;
    for (int i = 0; i < n; ++i) {
      jx_row<K>(current->v[i], current->lever[i], jx[i]);
      sizes.add(current->v[i], current->lever[i]);
    }
    const NormalEquations<n> square(jx, sizes.columns(), damping);
    regular = square.regular();
    if (!regular) {
      ++result.iterations;
      damping = std::max(10 * damping, 1e-3);
      continue;
    }
    // Near the solution the same factors serve a second, chord step: its error is the product
    // of two small ones, and it costs a third of a new factorisation.
    do {
      ++result.iterations;
      const std::array<double, n> step = square.solve(current->f);
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
      jx_row<K>(current->v[i], current->lever[i], jx[i]);
      if (jq_entry(robot.chain[i], current->v[i], driven[i]) * robot.chain[i].working_mode < 0 &&
          robot.chain[i].actuator != Actuator::telescopic) {
        result.status = Status::branch_lost;
        result.chain = i;
      }
    }
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
