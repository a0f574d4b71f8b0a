// The extended-to-joint matrix (TEJ), which corrects motor errors by redundant readings.
#pragma once

#include "mechanism/damping.hpp"
#include "mechanism/rkm.hpp"

namespace truepose {
using ExtendedColumns = Matrix<kMaxReadings, kMaxMotors>;  ///< M
using ExtendedRows = Matrix<kMaxMotors, kMaxReadings>;     ///< M⁺

/// M = [I; J_r J], Δq_e = M Δq, and its weighted pseudo-inverse TEJ = M⁺ = (MᵀWM)⁻¹MᵀW.
/// W is 1 for motors and the sensor's weight (1 in the paper) for redundant rows.
/// With more motors than freedoms K J, the motor motions that a platform motion allows (a
/// projection of rank n), replaces I: M = H_x J, M⁺ = K (H_xᵀWH_x)⁻¹H_xᵀW, so that every corrected
/// motor error is consistent. Built by recursive least squares, which keeps M⁺M = I (K J) to
/// rounding for any weight: M⁺ starts as [K J], whose motor columns are C = K (H_xᵀWH_x)⁻¹Kᵀ, and
/// each sensor, g its row of J_r J, adds
///
///     k = C gᵀ w / (1 + w g C gᵀ),     M⁺ ← [M⁺ - k (g M⁺), k]
void tej(const Robot& robot, const Jacobians& jacobians, const SensorRows& jr, ExtendedColumns& M,
         ExtendedRows& M_plus);

/// M and M⁺ at coordinates x. @param band  conditioning below which J is damped (0: the paper's)
/// @return near_singular where it is damped
inline Outcome tej(const Robot& robot, const Coordinates& x, ExtendedColumns& M,
                   ExtendedRows& M_plus, Real band = 0) {
  Closure closure;
  Jacobians jacobians;
  Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure, false);
  if (outcome) outcome = jacobian(closure, band, jacobians);
  const Outcome regular = outcome;
  Reading values;
  SensorRows jr;
  if (outcome) outcome = rkm(robot, closure, values, jr);
  if (!outcome) return outcome;
  tej(robot, jacobians, jr, M, M_plus);
  Real sum = 0;  // of each sensor's row and column: a row that overflowed leaves a column of 0
  for (int c = robot.motors; c < readings(robot); ++c)
    for (int i = 0; i < robot.motors; ++i) sum += M[c][i] + M_plus[i][c];
  return std::isfinite(sum) ? regular : Outcome{Status::not_finite, -1};
}
}  // namespace truepose
