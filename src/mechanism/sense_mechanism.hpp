// Readings of sensors on a mechanism of the engine, and their derivatives as twists times lines.
#pragma once

#include "mechanism/build.hpp"
#include "mechanism/sensor.hpp"

namespace truepose {
/// A sensor's value and gradients, all without the gain.
struct SensedFreedoms : Sensed {
  engine::Row row{};                                  ///< by all freedoms
  engine::Line platform{Vec3::Zero(), Vec3::Zero()};  ///< by a motion of the platform's side
};

/// Reads a sensor at any layout. An angle sensor at bar k's hinge reads -ψ_k.
/// @param theta  of the platform
SensedFreedoms sense(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                     const Sensor& sensor);

/// q_e at any layout. @return not_measured: an angle at the hinge of a missing bar; not_finite
Outcome read(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
             Extended& q_e);

/// q_e, H_x and, unless null, H_ξ at a closed position of any layout but the free one (see
/// linearise). At fixed x the motors and hidden freedoms u = (q, h) follow a parameter: with
/// A = ∂f/∂u and X = ∂f/∂x of all closures f(u; x, ξ) = 0,
///
///     A δu + X δx + f_ξ δξ = 0        δq_e = e_u δu + e_x δx + e_ξ δξ
///
/// so that S = e_u A⁻¹, one row per reading, gives H_x = e_x - S X and H_ξ = e_ξ - S f_ξ.
/// @return also singular, with the chain whose arm is stretched, or -1
Outcome linearise(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                  Extended& q_e, PoseRows& H_x, Real* H_xi);
}  // namespace truepose
