// Values and derivatives of all readings at a pose: q_e = [q; r], H_x = ∂q_e/∂x, H_ξ = ∂q_e/∂ξ.
#pragma once

#include "mechanism/levels.hpp"
#include "mechanism/parameters.hpp"

namespace truepose {
/// H_x of a closed pose: K = J_q⁻¹ J_x, and below it J_r.
void pose_rows(const Robot& robot, const Jacobians& jacobians, const SensorRows& jr, PoseRows& H_x);

/// q_e, H_x and H_ξ at a pose that the motors hold; at the full level D and θ (of a translation
/// robot: D) are held, the platform's tilt and its bars' turns follow.
/// @param q_e   out: readings of the motors, then of the sensors in use
/// @param H_x   out: along the free twist, m + r rows; the first m are K, the others J_r
/// @param H_xi  out unless null: along ξ at fixed pose, (m + r)×parameter_count(robot) numbers
/// @param rest  full level: residual motion. In: at a pose nearby; out: at this one, if ok
/// @return unreachable; singular where J has no inverse or an arm is stretched; not_finite where a
/// sensor has no reading or one of the derivatives is not finite; no_full_level (robot.full)
Outcome linearise(Level level, const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                  Real* H_xi, Parasitic* rest = nullptr);
}  // namespace truepose
