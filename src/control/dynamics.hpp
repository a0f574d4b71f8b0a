// The reduced dynamic model, in the platform's coordinates.
//
// Every loop closes exactly: q, q̇, q̈ follow from x, ẋ, ẍ through the closure and its two
// derivatives. Rotors and arms turn about the motors' axes, rods are slender (velocity linear
// between B and A, which is exact), platform bodies are rigid. D'Alembert:
//
//     M(x) ẍ + c(x, ẋ) = Kᵀ (τ - friction(q̇)),     q̇ = K ẋ,  K = J⁻¹ = J_q⁻¹ J_x
#pragma once

#include "mechanism/jacobian.hpp"

namespace truepose {
/// The reduced dynamics at one pose and velocity.
struct DynamicModel {
  int n;
  Square mass;       ///< M, full symmetric
  Coordinates bias;  ///< c: Coriolis, centrifugal and gravity forces; or M ẍ + c
  Square k;          ///< K, rows k_i
  Coordinates rate;  ///< q̇
  Joint slope;       ///< ∂(q as read)/∂(q as the motor turns)
};

/// Ṫ ẋ of a platform on passive axes: how D accelerates and the platform's turn changes at constant
/// joint rates. The axes before it turn an axis, ȧ_j = ω_{j-1} × a_j; all axes turn its arm.
Twist drifting(const Carried& carried, const Coordinates& rate);

/// M, c and K at a closed pose moving with the free twist `rate`; for a known acceleration, at half
/// the cost, M ẍ + c in place of c, without M.
/// @return singular (and the chain) where an entry of J_q vanishes; without M, jacobian() tests it
inline Outcome dynamic_model(const Robot& robot, const Closure& closure, const Coordinates& rate,
                             DynamicModel& model, const Coordinates* acceleration = nullptr) {
  const int n = model.n = dof(robot.mobility);
  const bool M = acceleration == nullptr;
  const Carried& twists = closure.carried;
  const Twist twist = to_twist(twists, rate);
  Twist drift = drifting(twists, rate);  // acceleration of the platform: at ẍ = 0, or at ẍ
  if (!M) {
    const Twist known = to_twist(twists, *acceleration);
    drift.velocity += known.velocity;
    drift.omega += known.omega;
  }
  const Vec3 g = robot.gravity;
  for (int i = 0; i < n; ++i) {
    if (M) model.mass[i].fill(0);
    model.bias[i] = 0;
  }

  // Masses on the platform add up to one spatial inertia about D and one wrench.
  Real mass = 0;
  Vec3 first = Vec3::Zero();   // Σ m l
  Mat3 second = Mat3::Zero();  // Σ m (|l|² - l lᵀ), and the bodies' own inertia
  Vec3 force = Vec3::Zero(), moment = Vec3::Zero();
  const auto hang = [&](Real m, const Vec3& l, const Vec3& f) {
    if (M) {
      mass += m;
      first += m * l;
      second += m * (l.squaredNorm() * Mat3::Identity() - outer(l, l));
    }
    force += f;
    moment += l.cross(f);
  };

  for (int i = 0; i < n; ++i) {
    const Chain& chain = robot.chain[i];
    const ChainState& at = closure.chain[i];
    auto& k = model.k[i];
    jx_row(twists, at.v, at.lever, k.data());
    if (M && !(at.jq * at.jq > kSingular * at.v.squaredNorm() * at.dB.squaredNorm()))
      return {Status::singular, i};
    // The motor's true angle counts here, not an eccentric encoder's reading.
    const Real per_jq = at.rate / at.jq, slope = 1 / at.rate;
    const Vec3 dB = slope * at.dB;
    model.slope[i] = slope;
    Real qd = 0;
    for (int j = 0; j < n; ++j) {
      k[j] *= per_jq;
      qd += k[j] * rate[j];
    }
    model.rate[i] = qd;

    // Second derivative of the closure: q̈ = k ẍ + h. aA, aB: accelerations of A and B at ẍ = 0.
    const Vec3 swing = twist.omega.cross(at.lever);
    const Vec3 centripetal =  // acceleration of A at ẍ = 0
        twist.omega.cross(swing) + drift.velocity + drift.omega.cross(at.lever);
    const Vec3 stretch = dB * qd - twist.velocity - swing;  // v̇
    Vec3 aB = Vec3::Zero();
    Real right = at.v.dot(centripetal) - stretch.squaredNorm();
    if (chain.actuator == Actuator::revolute) {
      aB = -qd * qd * at.p;
      right -= at.v.dot(aB);
    } else if (chain.actuator == Actuator::telescopic) {
      right += qd * qd;
    }
    const Real h = right * per_jq;
    aB += dB * h;

    // Slender rod: virtual work of (m/6) [δB·(2B̈ + Ä) + δA·(B̈ + 2Ä)] - (m/2) (δB + δA)·g.
    const Real m2 = chain.rod_mass * 0.5, m3 = chain.rod_mass * (1.0 / 3), m6 = 0.5 * m3;
    const Vec3 fB = m3 * aB + m6 * centripetal - m2 * g;
    const Vec3 fA = m3 * centripetal + m6 * aB - m2 * g;
    hang(m3, at.lever, fA);
    const Real carried = chain.actuator == Actuator::revolute ? 0.5 : 1;  // arm's centre / carriage
    const Real own = chain.drive_inertia * h + dB.dot(fB - chain.arm_mass * carried * g);
    for (int row = 0; row < n; ++row) model.bias[row] += k[row] * own;
    if (!M) continue;
    Coordinates b;  // J_Aᵀ ∂B/∂q
    free_row(twists, dB, at.lever.cross(dB), b.data());
    const Real kk = chain.drive_inertia + m3 * dB.squaredNorm();
    for (int row = 0; row < n; ++row) {
      const Real kr = kk * k[row] + m6 * b[row], br = m6 * k[row];
      for (int column = 0; column <= row; ++column)
        model.mass[row][column] += kr * k[column] + br * b[column];
    }
  }

  for (int i = 0; i < robot.bodies; ++i) {
    const Body& body = robot.body[i];
    const Mat3& R = closure.placed().R;
    const Vec3 l = R * body.pivot;
    const Vec3 centripetal =
        twist.omega.cross(twist.omega.cross(l)) + drift.velocity + drift.omega.cross(l);
    hang(body.mass, l, body.mass * (centripetal - g));
    const Mat3 inertia = R * body.inertia * R.transpose();
    if (M) second += inertia;
    moment += twist.omega.cross(inertia * twist.omega) + inertia * drift.omega;
  }

  // [m, -[Σml]×; [Σml]×, second], its free rows and columns.
  Coordinates wrench;
  free_row(twists, force, moment, wrench.data());
  for (int row = 0; row < n; ++row) model.bias[row] += wrench[row];
  if (!M) return {};
  const Mat3 cross =
      Mat3::of(0, -first.z(), first.y(), first.z(), 0, -first.x(), -first.y(), first.x(), 0);
  for (int row = 0; row < n; ++row) {
    if (is_rotational(robot.mobility)) {  // Tᵀ of all this T
      const Vec3 &linear = twists.linear[row], &turn = twists.axis[row];
      const Vec3 pushed = mass * linear + turn.cross(first);
      const Vec3 twisted = first.cross(linear) + second * turn;
      for (int column = 0; column <= row; ++column) {
        model.mass[row][column] +=
            pushed.dot(twists.linear[column]) + twisted.dot(twists.axis[column]);
        model.mass[column][row] = model.mass[row][column];
      }
    } else {
      const int i = free_columns(robot.mobility)[row];
      for (int column = 0; column <= row; ++column) {
        const int j = free_columns(robot.mobility)[column];
        if (i < 3)
          model.mass[row][column] += i == j ? mass : 0;
        else
          model.mass[row][column] += j < 3 ? cross(i - 3, j) : second(i - 3, j - 3);
        model.mass[column][row] = model.mass[row][column];
      }
    }
  }
  return {};
}

/// Motor torques Jᵀ f of a force of the platform's coordinates.
Joint motor_torques(int n, const Square& J, const Coordinates& force, const Joint& slope);

/// Motor torques for an acceleration, without friction: τ = Jᵀ (M ẍ + c).
Joint inverse_dynamics(const DynamicModel& model, const Square& J, const Coordinates& acceleration);

/// Twist J v of the platform for rates v of the readings.
Coordinates pose_rate(const Jacobians& at, const Joint& rate);

/// Joint inertia JᵀMJ, of the motors' readings.
Square joint_inertia(const DynamicModel& model, const Square& J);

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
  for (int j = 0; j < n; ++j) force[j] = -model.bias[j];
  for (int i = 0; i < n; ++i) {
    const Real net = torque[i] - friction(robot.chain[i], model.rate[i]);
    for (int j = 0; j < n; ++j) force[j] += model.k[i][j] * net;
  }
  Coordinates size;
  for (int j = 0; j < n; ++j) size[j] = model.mass[j][j];
  const Ldlt factor(n, model.mass, size);
  if (!factor.regular()) return {Status::singular, -1};
  factor.solve(force);
  for (int j = 0; j < n; ++j) acceleration[j] = force[j];
  if (!all_finite(acceleration, n)) return {Status::not_finite, -1};
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
