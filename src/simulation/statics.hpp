// Static equilibrium under a controller, without simulation of the motion.
#pragma once

#include "control/control.hpp"
#include "simulation/faults.hpp"
#include "simulation/plant.hpp"

namespace truepose {
/// Settings of the static equilibrium kp ê_q + τ_ff(x_d) = τ_hold(x), nominal feed-forward against
/// true weight; M_q(x_d) kp ê_q with inertia-shaped gains. Without gravity, ê_q = 0.
struct StaticsSettings {
  ControlSettings control;
  bool gravity = false;  ///< false: ê_q = 0
};

/// Computes the true robot's steady-state pose under the nominal controller at x_d, with
/// unquantized readings. Quasi-Newton on ê_q with the nominal J: each step leaves the few per cent
/// by which J differs. It includes the load's change: gravity may be stiffer than a soft PD.
/// @param x         out
/// @param known     of the nominal robot, for weighted laws
/// @param off       offsets of the readings, for example from backlash
/// @param faults    faults of the readings; not_converged where the robot would run away
/// @param by_truth  out: whether the true robot, not the law, had no answer
Outcome settle(const Robot& nominal, const Robot& truth, const StaticsSettings& settings,
               const Coordinates& x_d, Coordinates& x, const Weighing& known = {},
               const Extended& off = {}, bool* by_truth = nullptr,
               FaultyReadings* faults = nullptr);

/// Computes the cross-sensitivity of a robot's steady-state pose to errors of the readings:
/// δx = leakage δq_e, n×(m + r), to first order; δx along the free twist.
///
/// At equilibrium ê_q(x_d, q_e) = 0, and for consistent readings every law has
/// ∂ê_q/∂q_e H_x = -J⁻¹. With q_e = h(x) + δq_e therefore δx = J ∂ê_q/∂q_e δq_e: -[J 0] for the
/// joint law, -J M⁺ for a TEJ, -∂x̂/∂q_e for a law of the pose; for `estimated` that is J times the
/// weighted TEJ, the gain of the fused readings, as for `weighted`.
Outcome leakage(const Robot& robot, Law law, const Coordinates& x, PoseColumns& leak,
                const Weighing& weighing = {});
}  // namespace truepose
