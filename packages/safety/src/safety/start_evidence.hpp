// What explains the motions of a start-up test: a healthy robot, or one miswiring.
//
// With all brakes but motor i's closed the robot has one degree of freedom: motor i's reading moves
// by an unknown s > 0 in the direction of the torque, other motors' by nothing, sensors' by column
// i of J_r J times s. An explanation changes that: one reading has another gain γ (−1: reversed,
// 0: frozen), two readings are exchanged, a motor turns the wrong way, another brake slips. s, and
// γ, follow by weighted least squares from the readings that the explanation leaves; χ² of the
// residuals, over all motors tested so far, is its misfit. Of the model's s only the sign and a
// tenth of its size count: inertia, brake times and the give of a brake are hardly known.
#pragma once

#include "math/chi2.hpp"
#include "safety/start_states.hpp"

namespace truepose::start_detail {
inline constexpr Real kGive = 0.15;   ///< of other motors' closed brakes, over s (assumed)
inline constexpr Real kShape = 0.05;  ///< relative error of J_r J, uncalibrated (assumed)
inline constexpr Real kBetter = 16;   ///< χ² by which one explanation is better than another: 4 σ
inline constexpr Real kNamed = 9;     ///< and by which it has to be to be named: 3 σ
inline constexpr Real kSeen = 5;      ///< σ by which a reading must have moved

/// Whether two readings have the same unit, and may be exchanged.
bool same_unit(const Robot& robot, int a, int b);

inline int hypotheses(int n, int e) { return 1 + e * (e + 1) / 2 + 2 * n; }

/// Hypothesis number `index`: healthy; another gain of each reading, exchanges; motors, brakes.
StartHypothesis hypothesis(int n, int e, int index);

/// A reading's gain relative to the others, and its σ.
struct StartGain {
  Real value = 1, sigma = INFINITY;
};

/// χ² of the evidence under an explanation. @param gain  out: for StartFinding::scale
Real misfit(const StartEvidence& evidence, int n, int e, const StartHypothesis& by,
            StartGain& gain);

/// Name of a reading's gain. @param moved  whether the reading has
inline StartFinding named(Real gain, bool moved) {
  if (!moved) return StartFinding::frozen;
  return gain < 0 ? StartFinding::reversed : StartFinding::scale;
}

/// Compares the misfits of all hypotheses.
/// @param candidates  out: readings of the explanations that are as good as the best
/// @return none: healthy; inconsistent: several explanations, or none; else the explanation
StartHypothesis verdict(const StartTest& test, const Robot& robot, Real most,
                        std::uint32_t& candidates);
}  // namespace truepose::start_detail
