// Largest second derivative of readings within the motors' torque limits.
#pragma once

#include "control/dynamics.hpp"
#include "estimation/linearise.hpp"

namespace truepose {
/// Computes the largest second derivative of every reading at a pose from rest, all motors at their
/// torque limits: |H_x M⁻¹Kᵀ| τ + |H_x M⁻¹ g|. 0 if any motor has no limit.
/// @return unreachable, singular
Outcome fastest(const Robot& robot, const Coordinates& x, Extended& most);

/// The same with torques up to these, and a share of gravity.
Outcome fastest_under(const Robot& robot, const Coordinates& x, const Joint& torque, Real gravity,
                      Extended& most);
}  // namespace truepose
