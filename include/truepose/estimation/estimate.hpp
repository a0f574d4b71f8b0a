// The pose estimate from all readings together, and its covariance.
//
// x̂ = argmin |q_e - h(x)|² in the metric C⁻¹, C = H_ξ Σ_ξ H_ξᵀ + Σ_s: the uncertainty of the
// readings, from geometry and counts alike. The weighted TEJ has the same weights.
#pragma once

#include <numbers>

#include "truepose/control/tej.hpp"
#include "truepose/estimation/knowledge.hpp"
#include "truepose/full/linearise.hpp"

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
/// rods' stress constant (full/full.hpp). Of whitened readings, which decide on a step, this is up
/// to 0.04 on calibrated Par4s.
inline constexpr Real kElasticSlope = 0.1;

/// Whether a Gauss-Newton step is the last.
/// @param size  (step/σ)² of the coordinate that moves most; `last`: of the step before
/// @param chi2  of as many readings as there are rows
inline bool is_last(Real size, Real last, Real chi2, int rows) {
  // With σ of nanometres, rounding makes larger steps: below σ/1000 and hardly shrinking is enough.
  const Real enough =
      kLastStep * std::max(Real(1), chi2 / rows);  // of the residual that remains anyway
  return size < enough || (size < 1e-6 && size > 0.25 * last);
}

/// Numbers of work space for `reading_covariance` (its H_xi and B) and `estimate`.
inline int estimate_work(const Robot& robot, int count) {
  return (dof(robot.mobility) + robot.r) * (parameter_count(robot) + count);
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
inline Real dot(int size, const Real* a, const Real* b) {
  Real sum[4] = {};
  int k = 0;
  for (; k + 4 <= size; k += 4)
    for (int j = 0; j < 4; ++j) sum[j] += a[k + j] * b[k + j];
  for (; k < size; ++k) sum[0] += a[k] * b[k];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/// C of gathered rows of H_ξ. @param B  those rows, (n + r)×count; overwritten
/// @return not_finite where C is no covariance: some σ is not a positive number
inline Outcome reading_covariance(const Robot& robot, const Knowledge& known, Real* B,
                                  ReadingCovariance& C) {
  const int rows = dof(robot.mobility) + robot.r;
  times_root(known, rows, B);
  bool positive = true;
  for (int i = 0; i < rows; ++i) {
    positive = positive && known.sigma[i] > 0;
    for (int j = 0; j <= i; ++j)
      C.L[i][j] = (i == j) + dot(known.count, B + i * known.count, B + j * known.count);
  }
  return {positive && C.factor(rows) ? Status::ok : Status::not_finite, -1};
}

/// The same at a pose, from its H_ξ. @param B  work space
inline Outcome reading_covariance(const Robot& robot, const Knowledge& known, const Real* H_xi,
                                  Real* B, ReadingCovariance& C) {
  gather(robot, known, H_xi, dof(robot.mobility) + robot.r, B);
  return reading_covariance(robot, known, B, C);
}

/// Removes whole turns of a joint from a difference of readings: the turn from which an encoder
/// counts is not part of the geometry.
inline Real within_turn(const Robot& robot, int reading, Real difference) {
  const int n = dof(robot.mobility);
  if (reading < n) return within_turn(robot.chain[reading], difference);
  const Sensor& sensor = robot.sensor[reading - n];
  return properties(sensor.kind).wraps
             ? without_turns(difference, 2 * std::numbers::pi_v<Real> * sensor.gain)
             : difference;
}

/// Readings minus expected ones, without whole turns of a joint.
inline void innovation(const Robot& robot, const Extended& q_e, const Extended& expected,
                       Extended& residual) {
  for (int i = 0; i < dof(robot.mobility) + robot.r; ++i)
    residual[i] = within_turn(robot, i, q_e[i] - expected[i]);
}

/// Generalised least squares at a pose: δx = gain (q_e - h(x)), and δx's covariance.
struct Fusion {
  PoseColumns gain;
  PoseMatrix covariance;
};

/// (HᵀC⁻¹H)⁻¹HᵀC⁻¹ and (HᵀC⁻¹H)⁻¹ by LDLᵀ on the whitened rows.
/// @return singular where the readings do not determine the pose
inline Outcome fuse(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
             const PoseRows& H_x, Fusion& fusion) {
  const int n = dof(robot.mobility);
  const int rows = n + robot.r;
  PoseRows A = H_x;
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < n; ++j) A[i][j] /= known.sigma[i];
  for (int j = 0; j < n; ++j) C.whiten(rows, &A[0][j], kMaxDof);
  Square normal{};
  Coordinates size;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j)
      for (int k = 0; k < rows; ++k) normal[i][j] += A[k][i] * A[k][j];
    size[i] = normal[i][i];
  }
  const Ldlt factor(n, normal, size);
  if (!factor.regular()) return {Status::singular, -1};
  for (int j = 0; j < n; ++j) {
    Coordinates unit{};
    unit[j] = 1;
    factor.solve(unit);
    for (int i = 0; i < n; ++i) fusion.covariance[i][j] = unit[i];
  }
  for (int c = 0; c < rows; ++c) {
    Coordinates column = A[c];
    factor.solve(column);
    for (int i = 0; i < n; ++i) fusion.gain[i][c] = column[i];
  }
  for (int i = 0; i < n; ++i) {  // times L⁻¹, from the right
    auto& row = fusion.gain[i];
    for (int c = rows - 1; c >= 0; --c) {
      for (int k = c + 1; k < rows; ++k) row[c] -= row[k] * C.L[k][c];
      row[c] /= C.L[c][c];
    }
    for (int c = 0; c < rows; ++c) row[c] /= known.sigma[c];
  }
  return {};
}

/// Result of a pose estimate.
struct Estimate {
  Outcome outcome;
  int iterations = 0;
  PoseMatrix covariance{};  ///< of the free twist at the pose
  Real chi2 = 0;  ///< of the readings' residuals; r on average where the knowledge is right
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
      : robot(of), known(about), n(dof(of.mobility)), rows(n + of.r), at(start) {}

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
    return {{}, iterations, fusion.covariance, cost};
  }
};
}  // namespace estimate_detail

/// Estimates the pose by weighted Gauss-Newton on all readings, with the weights at the start.
/// @param known  about the robot's own parameter values
/// @param pose   in: the start; out: x̂
/// @param work   estimate_work(robot, known.count) numbers; nullptr where known.count = 0
/// @param rest   as of ikm_full, for the full level
/// @param cap    steps
/// @return not_converged, singular or unreachable where no pose is found; `pose` is then the start
inline Estimate estimate_from(Level level, const Robot& robot, const Knowledge& known,
                              const Extended& q_e, Pose& pose, Real* work, Parasitic& rest, int cap) {
  estimate_detail::Search search(robot, known, pose);
  Real *H_xi = work, *B = work ? work + search.rows * parameter_count(robot) : nullptr;
  const auto linearised = [&](Real* by_geometry) {
    return linearise(level, robot, search.at, search.expected, search.H_x, by_geometry, rest);
  };
  Outcome outcome = linearised(H_xi);
  if (outcome) outcome = reading_covariance(robot, known, H_xi, B, search.C);
  int iterations = 0;
  for (; outcome; ++iterations) {
    innovation(robot, q_e, search.expected, search.residual);
    const Real next = search.chi2(search.residual), last = search.size;
    outcome.status = std::isfinite(next) ? Status::ok : Status::not_converged;
    if (outcome && !search.shorten(next)) {
      outcome = search.turn(next);
      const bool late = iterations >= kEstimateIterations - 2 && search.size < kLateStep;
      if (outcome && (late || is_last(search.size, last, search.cost, search.rows)))
        return search.found(iterations + 1, 1, pose);
    }
    if (!outcome) break;
    if (iterations == kEstimateIterations && std::max(search.promised, search.size) < kFlat)
      return search.found(iterations, 0, pose);
    search.found(iterations, search.length, search.at);
    const bool goes_on = all_finite(search.step, dof(robot.mobility)) && iterations < cap;
    outcome = goes_on ? linearised(nullptr) : Outcome{Status::not_converged, -1};
    if (outcome.status == Status::unreachable)  // of this step's pose, not of the readings
      outcome = {Status::not_converged, -1};
  }
  return {outcome, iterations};
}

/// Estimates the pose, starting at the motors' pose.
/// @param pose   in: a guess of that; out: x̂
/// @param rest   nullptr: nothing is known beforehand
inline Estimate estimate(Level level, const Robot& robot, const Knowledge& known, const Extended& q_e, Pose& pose,
                     Real* work, Parasitic* rest = nullptr) {
  if (!robot.finished) return {{Status::unfinished, -1}};
  if (!all_finite(q_e, dof(robot.mobility) + robot.r)) return {{Status::not_finite, -1}};
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
inline void weighted_tej(const Robot& robot, const PoseRows& H_x,
                         const Fusion& fusion, ExtendedRows& M_plus) {
  for (int i = 0; i < dof(robot.mobility); ++i)
    for (int c = 0; c < dof(robot.mobility) + robot.r; ++c)
      M_plus[i][c] = sum_of(dof(robot.mobility), [&](int j) { return H_x[i][j] * fusion.gain[j][c]; });
}
}  // namespace truepose
