// How do redundant readings correct the motors? The extended-to-joint matrix (TEJ).
#pragma once

#include "truepose/jacobian.hpp"
#include "truepose/rkm.hpp"

namespace truepose {

using ExtendedColumns = Matrix<kMaxReadings, kMaxDof>;  ///< M
using ExtendedRows = Matrix<kMaxDof, kMaxReadings>;     ///< M⁺

/// M = [I; J_r J], Δq_e = M Δq, and its weighted pseudo-inverse TEJ = M⁺ = (MᵀWM)⁻¹MᵀW.
/// W is 1 for motors and the sensor's weight (1 in the paper) for redundant rows.
/// MᵀWM = I + Σ w_k g_kᵀ g_k, with g_k the rows of J_r J, is never singular; its inverse C is
/// built by one rank-one (Sherman-Morrison) update a sensor, and M⁺ = C [I, g_kᵀ w_k …].
template <Mobility K>
inline void tej(const Robot& robot, const Jacobians<K>& jacobians,
                const Matrix<kMaxSensors, kDof<K>>& jr, ExtendedColumns& M, ExtendedRows& M_plus) {
  constexpr int n = kDof<K>;
  Square<K> C;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) M[i][j] = C[i][j] = i == j;
  std::array<double, n> Cg;
  const auto times_row = [&](const auto& g) {
    for (int i = 0; i < n; ++i) {
      Cg[i] = 0;
      for (int j = 0; j < n; ++j) Cg[i] += C[i][j] * g[j];
    }
  };
  for (int k = 0; k < robot.r; ++k) {
    auto& g = M[n + k];
    g.fill(0);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) g[j] += jr[k][i] * jacobians.J[i][j];
    times_row(g);
    double gCg = 0;
    for (int i = 0; i < n; ++i) gCg += g[i] * Cg[i];
    const double scale = robot.sensor[k].weight / (1 + robot.sensor[k].weight * gCg);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) C[i][j] -= scale * Cg[i] * Cg[j];
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) M_plus[i][j] = C[i][j];
  for (int k = 0; k < robot.r; ++k) {
    times_row(M[n + k]);
    for (int i = 0; i < n; ++i) M_plus[i][n + k] = robot.sensor[k].weight * Cg[i];
  }
}

/// M and M⁺ at coordinates x.
inline Outcome tej(const Robot& robot, const Joint& x, ExtendedColumns& M, ExtendedRows& M_plus) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Closure<K> closure;
    Jacobians<K> jacobians;
    Outcome outcome = ikm<K, false>(robot, to_pose<K>(x), closure);
    if (outcome) outcome = jacobian<K>(closure, jacobians);
    if (!outcome) return outcome;
    Reading values;
    Matrix<kMaxSensors, kDof<K>> jr;
    rkm<K>(robot, closure.pose, values, jr);
    tej<K>(robot, jacobians, jr, M, M_plus);
    return outcome;
  });
}

}  // namespace truepose
