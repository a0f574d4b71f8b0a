// The reduced dynamic model, in the platform's coordinates.
//
// Every loop closes exactly: q, q̇, q̈ follow from x, ẋ, ẍ through the closure and its two
// derivatives. Rotors and arms turn about the motors' axes, rods are slender (velocity linear
// between B and A, which is exact), platform bodies are rigid. D'Alembert:
//
//     M(x) ẍ + c(x, ẋ) = Kᵀ (τ - friction(q̇)),     q̇ = K ẋ,  K = J_q⁻¹ J_x
//
// m motors beyond the n freedoms leave m - n combinations of torques open, which only stress the
// robot: Jᵀ, the pseudo-inverse of Kᵀ, gives the torques of least norm.
#pragma once

#include "mechanism/jacobian.hpp"

namespace truepose {
/// The reduced dynamics at one pose and velocity.
struct DynamicModel {
  int n, motors;
  Square mass;       ///< M, full symmetric
  Coordinates bias;  ///< c: Coriolis, centrifugal and gravity forces; or M ẍ + c
  Square k;          ///< K, rows k_i
  Joint rate;        ///< q̇
  Joint slope;       ///< ∂(q as read)/∂(q as the motor turns)
};

/// Ṫ ẋ of a platform on passive axes: how D accelerates and the platform's turn changes at constant
/// joint rates. The axes before it turn an axis, ȧ_j = ω_{j-1} × a_j; all axes turn its arm.
Twist drifting(const Carried& carried, const Coordinates& rate);

/// M, c and K at a closed pose moving with the free twist `rate`; for a known acceleration, at half
/// the cost, M ẍ + c in place of c, without M.
/// @return singular (and the chain) where an entry of J_q vanishes; without M, jacobian() tests it
Outcome dynamic_model(const Robot& robot, const Closure& closure, const Coordinates& rate,
                      DynamicModel& model, const Coordinates* acceleration = nullptr);

/// Motor torques Jᵀ f of a force of the platform's coordinates.
Joint motor_torques(int n, int motors, const Square& J, const Coordinates& force,
                    const Joint& slope);

/// Motor torques for an acceleration, without friction: τ = Jᵀ (M ẍ + c).
Joint inverse_dynamics(const DynamicModel& model, const Square& J, const Coordinates& acceleration);

/// Joint inertia JᵀMJ, of the motors' readings.
Square joint_inertia(const DynamicModel& model, const Square& J);

/// The model at a pose at rest.
struct AtRest {
  Jacobians jacobians;
  Closure closure;
  DynamicModel model;
  Square inertia;  ///< of the motors

  Outcome find(const Robot& robot, const Pose& pose) {
    Outcome outcome = jacobian_at(robot, pose, closure, jacobians);
    if (outcome) outcome = dynamic_model(robot, closure, Coordinates{}, model);
    if (outcome) inertia = joint_inertia(model, jacobians.J);
    return outcome;
  }
  /// Speed of the reference point (on passive axes: of the axes) per speed of a motor.
  Real lever(int motor) const {
    return sqrt(sum_of(positions_of(closure.carried.mobility),
                       [&](int j) { return jacobians.J[j][motor] * jacobians.J[j][motor]; }));
  }
};

/// Friction of a motor, N·m or N: viscous, and Coulomb smoothed over ±kStiction rad/s (or m/s) to
/// keep the integration regular; a robot at rest creeps below that speed.
inline constexpr Real kStiction = 1e-3;
inline Real friction(const Chain& chain, Real rate) {
  const Real viscous = chain.viscous * rate;
  return chain.coulomb > 0 ? viscous + chain.coulomb * std::tanh(rate / kStiction) : viscous;
}

/// Acceleration ẍ under torques that may depend on the motors' positions and rates.
/// @param torque_of  torque_of(closure, model) -> Joint
/// @return unreachable, singular, not_finite, or ok
template <class Torque>
inline Outcome forward_dynamics_under(const Robot& robot, const Pose& pose, const Coordinates& rate,
                                      Torque&& torque_of, Coordinates& acceleration) {
  const int n = dof(robot.mobility);
  Closure closure;
  DynamicModel model;
  Outcome outcome = ikm(robot, pose, closure);
  if (outcome) outcome = dynamic_model(robot, closure, rate, model);
  if (!outcome) return outcome;
  const Joint torque = torque_of(closure, model);
  Coordinates force;
  for (int j : range(n)) force[j] = -model.bias[j];
  for (int i : range(robot.motors)) {
    const Real net = torque[i] - friction(robot.chain[i], model.rate[i]);
    for (int j : range(n)) force[j] += model.k[i][j] * net;
  }
  Coordinates size;
  for (int j : range(n)) size[j] = model.mass[j][j];
  const Ldlt factor(n, model.mass, size);
  if (!factor.regular()) return {Status::singular};
  factor.solve(force);
  for (int j : range(n)) acceleration[j] = force[j];
  if (!all_finite(acceleration, n)) return {Status::not_finite};
  return outcome;
}

inline Outcome forward_dynamics(const Robot& robot, const Pose& pose, const Coordinates& rate,
                                const Joint& torque, Coordinates& acceleration) {
  return forward_dynamics_under(
      robot, pose, rate, [&](const auto&, const auto&) { return torque; }, acceleration);
}

/// Motor torques for an acceleration, with friction: the inverse of forward_dynamics.
Outcome inverse_dynamics(const Robot& robot, const Pose& pose, const Coordinates& rate,
                         const Coordinates& acceleration, Joint& torque);

/// M(x), of the free twist.
Outcome mass_matrix(const Robot& robot, const Pose& pose, PoseMatrix& mass);
}  // namespace truepose
