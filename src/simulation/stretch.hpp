// Deflection of rods, legs, belts and arms under load.
//
// A rod of length L under the tension T has length L (1 + c T), c its compliance. The rods alone
// hold the load on the platform, a force and weights (half of each rod's weight). Along every
// freedom z of platform and bars, by virtual work,
//
//     Σ_k T_k v_k/|v_k| · ∂A_k/∂z + w = 0
//
// At the ideal level z is x, with as many chains. At the full level each rod counts; where one is
// too many, all act as equal springs: T is the smallest that holds. Tensions are those of the
// unloaded geometry; they differ by the order of the strain. Readings are therefore those of a
// robot with other rods, and ∂q_e/∂c follows from H_ξ. An arm turns by its compliance times the
// motor's torque, which its encoder does not see:
//
//     τ_i = Σ T_k v_k/|v_k| · ∂B_i/∂p - (m_arm + m_rods)/2 g · ∂B_i/∂p
#pragma once

#include <limits>

#include "estimation/linearise.hpp"

namespace truepose {
/// Load on a robot's rods, in addition to its weight.
struct Load {
  Vec3 force = Vec3::Zero();  ///< on the platform's reference point, N, base frame
  /// Measured tension of a chain's rods together, N; NaN: computed from the load.
  Joint tension = [] {
    Joint unknown;
    unknown.fill(std::numeric_limits<Real>::quiet_NaN());
    return unknown;
  }();
};

/// Effect of a load on each chain. Its compliance is that of all its rods together: a rod of a pair
/// has twice as much.
struct Pull {
  Joint tension{};     ///< of all its rods together, N
  Joint length{};      ///< mean growth of its rods per unit of compliance, m·N
  Joint difference{};  ///< growth of the rod on the +u side minus that of the other
  Joint rate{};        ///< ∂position/∂q of its motor
  Joint torque{};      ///< of its motor, N·m or N
};

/// At a pose held by the motors, at either level. A pair shares a measured tension with the
/// difference that holds the load.
/// @return singular where the rods hold nothing along some freedom
Outcome pull(Level level, const Robot& robot, const Pose& pose, const Load& load, Pull& by);

/// Readings of a robot under load at a pose.
struct UnderLoad {
  Extended q_e;
  Joint tension;  ///< of every chain, N
  /// ∂q_e/∂(compliance) of every chain, then of every chain's arm, x held.
  Matrix<kMaxReadings, 2 * kMaxChains> by_compliance{};
};

/// Computes the readings under load and their derivatives by compliance.
/// @param compliance  of every chain, 1/N
/// @param arms        compliance of every arm, rad/(N·m)
/// @param H_xi        work space, (m + r) × parameter_count
Outcome under_load(Level level, const Robot& robot, const Pose& pose, const Joint& compliance,
                   const Joint& arms, const Load& load, double* H_xi, UnderLoad& result);
}  // namespace truepose
