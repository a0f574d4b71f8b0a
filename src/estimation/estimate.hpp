// The pose estimate from all readings together, and its covariance.
//
// x̂ = argmin |q_e - h(x)|² in the metric C⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s: the uncertainty of the
// readings, from geometry and counts alike. The weighted TEJ has the same weights.
#pragma once

#include "control/tej.hpp"
#include "estimation/knowledge.hpp"
#include "estimation/linearise.hpp"

namespace truepose {
inline constexpr int kEstimateIterations = 16;  ///< 5 from the motors' pose where readings agree

/// (step/σ)² below which a Gauss-Newton step is the last: 1e-5 of a σ (single: 3e-3). The remaining
/// error is its square, or a few per cent of it where readings disagree by several σ.
inline constexpr Real kLastStep = by_precision(1e-10, 1e-5);

/// The same where a search must end: at its last two iterations, and in a control cycle after
/// kQuickSteps. 3e-3 of σ add 1e-5 of the variance; where steps shrink by no more than a tenth, a
/// few hundredths of σ remain.
inline constexpr Real kLateStep = 1e-5;

/// Steps that suffice in most cycles of a controller.
inline constexpr int kQuickSteps = 2;

/// Decrease of χ² that a step may still promise at the last iteration, or where a control cycle has
/// no steps left: below the readings' resolution. Where these leave a coordinate open, curvature
/// makes Gauss-Newton creep within σ.
inline constexpr Real kFlat = 0.5;

/// χ² by reading, of 10 σ each, beyond which a control cycle's search may be in another valley: it
/// goes on.
inline constexpr Real kPlausible = 100;

/// Share of the readings' slope that the elastic full level may neglect: its derivatives keep the
/// rods' stress constant (mechanism/full.hpp). Of whitened readings, which decide on a step, this
/// is up to 0.04 on calibrated Par4s.
inline constexpr Real kElasticSlope = 0.1;

/// (step/σ)², as a share of kLastStep, below which the next step may be predicted to be: 3e-8 of a
/// σ.
inline constexpr Real kPredicted = 1e-5;

/// Whether a Gauss-Newton step is the last.
/// @param size   (step/σ)² of the coordinate that moves most; `last`: of the step before
/// @param chi2   of as many readings as there are rows
/// @param whole  the step before was taken as it was: steps shrink at least at its rate
bool is_last(Real size, Real last, Real chi2, int rows, bool whole = true);

/// The same late in a search. @param counted  in a control cycle
inline bool is_late(Real size, int iterations, bool counted) {
  return size < kLateStep && iterations >= (counted ? kQuickSteps + 1 : kEstimateIterations - 2);
}

/// Numbers of work space for `reading_covariance` (its H_xi and B) and `estimate`.
inline int estimate_work(const Robot& robot, int count) {
  return readings(robot) * (parameter_count(robot) + count);
}

/// Lower triangular L with C = L Lᵀ, in units of the readings' σ.
struct ReadingCovariance {
  Matrix<kMaxReadings, kMaxReadings> L;

  /// Factors C from its lower triangle in L. @return false where C is no covariance
  bool factor(int rows) {
    for (int i : range(rows))
      for (int j : range(i + 1)) {
        Real sum = L[i][j];
        for (int k : range(j)) sum -= L[i][k] * L[j][k];
        if (i > j) {
          L[i][j] = sum / L[j][j];
        } else {
          if (!(sum > 0 && isfinite(sum))) return false;
          L[i][i] = sqrt(sum);
        }
      }
    return true;
  }

  /// L⁻¹ b in place, b of `rows` entries `stride` apart.
  void whiten(int rows, Real* b, int stride) const {
    for (int i : range(rows)) {
      Real sum = b[i * stride];
      for (int k : range(i)) sum -= L[i][k] * b[k * stride];
      b[i * stride] = sum / L[i][i];
    }
  }

  /// L⁻ᵀ b in place: after whiten(), C⁻¹ b.
  void colour(int rows, Real* b) const {
    for (int i = rows; i-- > 0;) {
      Real sum = b[i];
      for (int k : range(i + 1, rows)) sum -= L[k][i] * b[k];
      b[i] = sum / L[i][i];
    }
  }
};

/// aᵀb in four independent sums, for speed.
Real dot(int size, const Real* a, const Real* b);

/// C at a pose, from its H_ξ. @param B  work space, (m + r)×count; in: the entries of parameters
/// without a column; out: the uncertainty of the readings in units of their σ
/// @return not_finite where C is no covariance: some σ is not a positive number
Outcome reading_covariance(const Robot& robot, const Knowledge& known, const Real* H_xi, Real* B,
                           ReadingCovariance& C);

/// Removes whole turns of a joint from a difference of readings: the turn from which an encoder
/// counts is not part of the geometry.
Real within_turn(const Robot& robot, int reading, Real difference);

/// Readings minus expected ones, without whole turns of a joint.
inline void innovation(const Robot& robot, const Extended& q_e, const Extended& expected,
                       Extended& residual) {
  for (int i : range(readings(robot))) residual[i] = within_turn(robot, i, q_e[i] - expected[i]);
}

/// Generalised least squares at a pose: δx = gain (q_e - h(x)), and δx's covariance.
struct Fusion {
  PoseColumns gain;
  PoseMatrix covariance;
};

/// (HᵀC⁻¹H)⁻¹HᵀC⁻¹ and (HᵀC⁻¹H)⁻¹ by LDLᵀ on the whitened rows.
/// @return singular where the readings do not determine the pose
Outcome fuse(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
             const PoseRows& H_x, Fusion& fusion);

/// Result of a pose estimate.
struct Estimate {
  Outcome outcome;
  int iterations = 0;
  Real chi2 = 0;  ///< of the readings' residuals; m - n + r on average where the knowledge is right
  PoseMatrix covariance{};  ///< of the free twist at the pose
  explicit operator bool() const { return bool(outcome); }
};

/// Readings expected at a pose, and their slopes.
struct Expected {
  Pose pose;
  Extended q_e;
  PoseRows H_x;
};

/// χ² of the readings at a pose. @param white  out: their whitened residual
Real chi2(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
          const Extended& q_e, const Extended& expected, Extended& white);

/// Searches for the pose of all readings by weighted Gauss-Newton.
/// @param C     the weights
/// @param at    in: the start; out: at x̂, or where the search would go on
/// @param rest  as of linearise, for the full level
/// @param done  steps that this search has taken before
/// @param cap   steps in all
Estimate search(Level level, const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
                const Extended& q_e, Expected& at, Parasitic& rest, int done, int cap);

/// Estimates the pose by weighted Gauss-Newton on all readings from the motors' pose, with the
/// weights there.
/// @param known  about the robot's own parameter values
/// @param pose   in: a guess of the motors' pose; out: x̂
/// @param work   estimate_work(robot, known.count) numbers; nullptr where known.count = 0
/// @return not_converged, singular or unreachable where no pose is found; `pose` is then the guess
Estimate estimate(Level level, const Robot& robot, const Knowledge& known, const Extended& q_e,
                  Pose& pose, Real* work);

/// Weighted TEJ at a pose: M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹ with M = H_x J, hence J⁻¹ times the gain.
void weighted_tej(const Robot& robot, const PoseRows& H_x, const Fusion& fusion,
                  ExtendedRows& M_plus);
}  // namespace truepose
