// The pose estimate from all readings together, and its covariance.
//
// x̂ = argmin |q_e - h(x)|² in the metric C⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s: the uncertainty of the
// readings, from geometry and counts alike. The weighted TEJ has the same weights.
#pragma once

#include <numbers>

#include "control/tej.hpp"
#include "estimation/knowledge.hpp"
#include "estimation/linearise.hpp"

namespace truepose {
inline constexpr int kEstimateIterations = 16;  ///< 5 from the motors' pose where readings agree

/// (step/σ)² below which a Gauss-Newton step is the last: 1e-5 of a σ (single: 3e-3). The remaining
/// error is its square, or a few per cent of it where readings disagree by several σ.
inline constexpr Real kLastStep = by_precision(1e-10, 1e-5);

/// The same for the last two iterations: where readings disagree and hardly determine a coordinate,
/// steps may shrink by no more than a tenth, and a few hundredths of σ remain.
inline constexpr Real kLateStep = 1e-5;

/// Decrease of χ² that a step may still promise at the last iteration: below the readings'
/// resolution. Where these leave a coordinate open, curvature makes Gauss-Newton creep within σ.
inline constexpr Real kFlat = 0.5;

/// Share of the readings' slope that the elastic full level may neglect: its derivatives keep the
/// rods' stress constant (mechanism/full.hpp). Of whitened readings, which decide on a step, this
/// is up to 0.04 on calibrated Par4s.
inline constexpr Real kElasticSlope = 0.1;

/// Whether a Gauss-Newton step is the last.
/// @param size  (step/σ)² of the coordinate that moves most; `last`: of the step before
/// @param chi2  of as many readings as there are rows
bool is_last(Real size, Real last, Real chi2, int rows);

/// Numbers of work space for `reading_covariance` (its H_xi and B) and `estimate`.
inline int estimate_work(const Robot& robot, int count) {
  return readings(robot) * (parameter_count(robot) + count);
}

/// Lower triangular L with C = L Lᵀ, in units of the readings' σ.
struct ReadingCovariance {
  Matrix<kMaxReadings, kMaxReadings> L;

  /// Factors C from its lower triangle in L. @return false where C is no covariance
  bool factor(int rows) {
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j <= i; ++j) {
        Real sum = L[i][j];
        for (int k = 0; k < j; ++k) sum -= L[i][k] * L[j][k];
        if (i > j) {
          L[i][j] = sum / L[j][j];
        } else {
          if (!(sum > 0 && std::isfinite(sum))) return false;
          L[i][i] = std::sqrt(sum);
        }
      }
    return true;
  }

  /// L⁻¹ b in place, b of `rows` entries `stride` apart.
  void whiten(int rows, Real* b, int stride) const {
    for (int i = 0; i < rows; ++i) {
      Real sum = b[i * stride];
      for (int k = 0; k < i; ++k) sum -= L[i][k] * b[k * stride];
      b[i * stride] = sum / L[i][i];
    }
  }

  /// L⁻ᵀ b in place: after whiten(), C⁻¹ b.
  void colour(int rows, Real* b) const {
    for (int i = rows; i-- > 0;) {
      Real sum = b[i];
      for (int k = i + 1; k < rows; ++k) sum -= L[k][i] * b[k];
      b[i] = sum / L[i][i];
    }
  }
};

/// aᵀb in four independent sums, for speed.
Real dot(int size, const Real* a, const Real* b);

/// C of gathered rows of H_ξ. @param B  those rows, (m + r)×count; overwritten
/// @return not_finite where C is no covariance: some σ is not a positive number
Outcome reading_covariance(const Robot& robot, const Knowledge& known, Real* B,
                           ReadingCovariance& C);

/// The same at a pose, from its H_ξ. @param B  work space
inline Outcome reading_covariance(const Robot& robot, const Knowledge& known, const Real* H_xi,
                                  Real* B, ReadingCovariance& C) {
  gather(robot, known, H_xi, readings(robot), B);
  return reading_covariance(robot, known, B, C);
}

/// Removes whole turns of a joint from a difference of readings: the turn from which an encoder
/// counts is not part of the geometry.
Real within_turn(const Robot& robot, int reading, Real difference);

/// Readings minus expected ones, without whole turns of a joint.
inline void innovation(const Robot& robot, const Extended& q_e, const Extended& expected,
                       Extended& residual) {
  for (int i = 0; i < readings(robot); ++i)
    residual[i] = within_turn(robot, i, q_e[i] - expected[i]);
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

namespace estimate_detail {
/// Gauss-Newton steps to the pose of all readings, with the weights at the start.
struct Search {
  const Robot& robot;
  const Knowledge& known;
  const int n, rows;
  Pose at, base;  ///< present pose; the last one that lowered the cost
  Extended expected, residual{};
  PoseRows H_x;
  ReadingCovariance C;
  Fusion fusion;
  Coordinates step{};  ///< from the base
  Real cost = INFINITY, promised = 0, length = 1, size = INFINITY;

  Search(const Robot& of, const Knowledge& about, const Pose& start)
      : robot(of), known(about), n(dof(of.mobility)), rows(readings(of)), at(start) {}

  /// χ² of a difference of readings.
  Real chi2(Extended difference) const {
    for (int c = 0; c < rows; ++c) difference[c] /= known.sigma[c];
    C.whiten(rows, difference.data(), 1);
    return sum_of(rows, [&](int c) { return difference[c] * difference[c]; });
  }

  /// Shortens a step with less than a quarter of the predicted decrease to the minimum of the
  /// parabola of both costs and the first slope, below 4/7 of it: where readings disagree by many
  /// σ, curvature makes steps overshoot. Inexact slopes may raise the cost along it by 2 |whitened|
  /// times their share of the promised change of the readings. @return whether it was shortened
  bool shorten(Real next) {
    const Real slope = robot.full.kind == FullKind::elastic ? kElasticSlope : 0;
    const Real inexact =
        2 * slope * length * std::sqrt(std::min(cost, next) * std::max(promised, Real(0)));
    const Real most =
        cost - 0.25 * length * promised + by_precision(1e-12, 1e-5) * cost + 1e-9 + inexact;
    if (!(next > most && std::isfinite(cost) && length > 1e-3)) return false;
    length *= std::max(Real(0.1), length * promised / (next - cost + 2 * length * promised));
    return true;
  }

  /// Sets a new step from here, its size, each coordinate against its own σ, and the decrease of
  /// the cost that it promises. Curvature may also make successive steps shrink by a constant
  /// ratio: the secant then goes to where they vanish, or ahead where they grow.
  Outcome turn(Real next) {
    const Outcome outcome = fuse(robot, known, C, H_x, fusion);
    if (!outcome) return outcome;
    base = at;
    cost = next;
    const Coordinates before = step;
    Real along = 0, whole2 = 0;  // of the last one
    size = 0;
    for (int i = 0; i < n; ++i) {
      step[i] = sum_of(rows, [&](int c) { return fusion.gain[i][c] * residual[c]; });
      size = std::max(size, step[i] * step[i] / fusion.covariance[i][i]);
      along += step[i] * before[i] / fusion.covariance[i][i];
      whole2 += before[i] * before[i] / fusion.covariance[i][i];
    }
    if (!(std::fabs(along) > 0.25 * whole2))
      length = 1;
    else if (along < 0.9 * whole2)
      length = std::max(Real(0.1), std::min(length * whole2 / (whole2 - along), Real(10)));
    else
      length = 10;
    Extended left{};
    for (int c = 0; c < rows; ++c)
      left[c] = residual[c] - sum_of(n, [&](int i) { return H_x[c][i] * step[i]; });
    promised = cost - chi2(left);
    return {};
  }

  /// The result at the base after `part` of the step.
  Estimate found(int iterations, Real part, Pose& pose) const {
    Coordinates whole = step;
    for (Real& entry : whole) entry *= part;
    pose = moved(robot.mobility, base, whole);
    return {{}, iterations, cost, fusion.covariance};
  }
};
}  // namespace estimate_detail

/// Estimates the pose by weighted Gauss-Newton on all readings, with the weights at the start.
/// @param known  about the robot's own parameter values
/// @param pose   in: the start; out: x̂
/// @param work   estimate_work(robot, known.count) numbers; nullptr where known.count = 0
/// @param rest   as of linearise, for the full level
/// @param cap    steps
/// @return not_converged, singular or unreachable where no pose is found; `pose` is then the start
Estimate estimate_from(Level level, const Robot& robot, const Knowledge& known, const Extended& q_e,
                       Pose& pose, Real* work, Parasitic& rest, int cap);

/// Estimates the pose, starting at the motors' pose.
/// @param pose   in: a guess of that; out: x̂
/// @param rest   nullptr: nothing is known beforehand
inline Estimate estimate(Level level, const Robot& robot, const Knowledge& known,
                         const Extended& q_e, Pose& pose, Real* work, Parasitic* rest = nullptr) {
  if (!robot.finished) return {{Status::unfinished, -1}};
  if (!all_finite(q_e, readings(robot))) return {{Status::not_finite, -1}};
  Pose at = pose;
  Parasitic own;
  if (!rest) rest = &own;
  const Status motors = motors_pose(level, robot, motors_of(robot, q_e), at, *rest);
  if (motors != Status::ok && motors != Status::not_converged) at = pose;
  const Estimate result =
      estimate_from(level, robot, known, q_e, at, work, *rest, kEstimateIterations);
  if (result) pose = at;
  return result;
}

/// Weighted TEJ at a pose: M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹ with M = H_x J, hence J⁻¹ times the gain.
void weighted_tej(const Robot& robot, const PoseRows& H_x, const Fusion& fusion,
                  ExtendedRows& M_plus);
}  // namespace truepose
