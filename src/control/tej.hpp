// The extended-to-joint matrix (TEJ), which corrects motor errors by redundant readings.
#pragma once

#include "estimation/linearise.hpp"

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
Outcome tej(const Robot& robot, const Coordinates& x, ExtendedColumns& M, ExtendedRows& M_plus,
            Real band = 0);

/// Motors and readings at a pose, J and J_r: by closed forms, or of a described mechanism by the
/// engine, where nothing is damped. @param closure  of a described mechanism: pose and q alone
/// @param rest  of a described mechanism: as of ikm to a FullClosure
/// @return near_singular where J is damped
Outcome kinematics_at(const Robot& robot, const Pose& pose, Real band, Closure& closure,
                      Jacobians& jacobians, Reading& r, SensorRows& jr, Parasitic* rest = nullptr);
}  // namespace truepose
