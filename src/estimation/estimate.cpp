// The pose estimate from all readings together, and its covariance.
#include "estimation/estimate.hpp"

namespace truepose {
bool is_last(Real size, Real last, Real chi2, int rows, bool whole) {
  // With σ of nanometres, rounding makes larger steps: below σ/1000 and hardly shrinking is enough.
  const Real enough = kLastStep * max(Real(1), chi2 / rows);  // of the residual that remains anyway
  const bool next = whole && last < INFINITY && size * size < kPredicted * enough * last;
  return size < enough || next || (size < 1e-6 && size > 0.25 * last);
}

Real dot(int size, const Real* a, const Real* b) {
  Real sum[4] = {};
  int k = 0;
  for (; k + 4 <= size; k += 4)
    for (int j : range(4)) sum[j] += a[k + j] * b[k + j];
  for (; k < size; ++k) sum[0] += a[k] * b[k];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

Outcome reading_covariance(const Robot& robot, const Knowledge& known, const Real* H_xi, Real* B,
                           ReadingCovariance& C) {
  const int rows = readings(robot);
  gather(robot, known, H_xi, rows, B);
  times_root(known, rows, B);
  bool positive = true;
  for (int i : range(rows)) {
    positive = positive && known.sigma[i] > 0;
    for (int j : range(i + 1))
      C.L[i][j] = (i == j) + dot(known.count, B + i * known.count, B + j * known.count);
  }
  return {positive && C.factor(rows) ? Status::ok : Status::not_finite};
}

Real within_turn(const Robot& robot, int reading, Real difference) {
  const int m = robot.motors;
  if (reading < m) return within_turn(robot.chain[reading], difference);
  const Sensor& sensor = robot.sensor[reading - m];
  return properties(sensor.kind).wraps ? without_turns(difference, 2 * kPi * sensor.gain)
                                       : difference;
}

namespace {
/// Whitens rows, A = L⁻¹ H_x, and factors their normal equations AᵀA δx = Aᵀe.
/// @param A           in: H_x
/// @param covariance  out: (AᵀA)⁻¹
Ldlt normal_equations(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
                      PoseRows& A, PoseMatrix& covariance) {
  const int n = dof(robot.mobility), rows = readings(robot);
  for (int i : range(rows))
    for (int j : range(n)) A[i][j] /= known.sigma[i];
  for (int j : range(n)) C.whiten(rows, &A[0][j], kMaxDof);
  Square normal{};
  Coordinates size;
  for (int i : range(n)) {
    for (int j : range(i + 1))
      for (int k : range(rows)) normal[i][j] += A[k][i] * A[k][j];
    size[i] = normal[i][i];
  }
  const Ldlt factors(n, normal, size);
  for (int j : range(n)) {
    Coordinates unit{};
    unit[j] = 1;
    factors.solve(unit);
    for (int i : range(n)) covariance[i][j] = unit[i];
  }
  return factors;
}

/// Gauss-Newton steps to the pose of all readings.
struct Search {
  const Robot& robot;
  const Knowledge& known;
  const ReadingCovariance& C;
  Expected& at;
  const int n = dof(robot.mobility), rows = readings(robot);
  Pose base = at.pose;  ///< the last pose that lowered the cost
  Extended white{};     ///< whitened residual at the present pose
  PoseMatrix covariance{};
  Coordinates step{};  ///< from the base
  Real cost = INFINITY, promised = 0, length = 1, size = INFINITY;

  /// Shortens a step with less than a quarter of the predicted decrease to the minimum of the
  /// parabola of both costs and the first slope, below 4/7 of it: where readings disagree by many
  /// σ, curvature makes steps overshoot. Inexact slopes may raise the cost along it by 2 |whitened|
  /// times their share of the promised change of the readings. @return whether it was shortened
  bool shorten(Real next) {
    const Real slope = robot.full.kind == FullKind::elastic ? kElasticSlope : 0;
    const Real inexact = 2 * slope * length * sqrt(min(cost, next) * max(promised, Real(0)));
    const Real most =
        cost - 0.25 * length * promised + by_precision(1e-12, 1e-5) * cost + 1e-9 + inexact;
    if (!(next > most && isfinite(cost) && length > 1e-3)) return false;
    length *= max(Real(0.1), length * promised / (next - cost + 2 * length * promised));
    return true;
  }

  /// Sets a new step from here, its size, each coordinate against its own σ, and the decrease of
  /// the cost that it promises. Curvature may also make successive steps shrink by a constant
  /// ratio: the secant then goes to where they vanish, or ahead where they grow.
  Outcome turn(Real next) {
    PoseRows A = at.H_x;
    const Ldlt equations = normal_equations(robot, known, C, A, covariance);
    if (!equations.regular()) return {Status::singular};
    base = at.pose;
    cost = next;
    const Coordinates before = step;
    Real along = 0, whole2 = 0;  // of the last one
    Coordinates slope{};
    for (int i : range(n)) slope[i] = sum_of(rows, [&](int c) { return A[c][i] * white[c]; });
    step = slope;
    equations.solve(step);
    size = promised = 0;
    for (int i : range(n)) {
      promised += slope[i] * step[i];
      size = max(size, step[i] * step[i] / covariance[i][i]);
      along += step[i] * before[i] / covariance[i][i];
      whole2 += before[i] * before[i] / covariance[i][i];
    }
    if (!(fabs(along) > 0.25 * whole2))
      length = 1;
    else if (along < 0.9 * whole2)
      length = max(Real(0.1), min(length * whole2 / (whole2 - along), Real(10)));
    else
      length = 10;
    return {};
  }

  /// Goes from the base by `part` of the step.
  void go(Real part) {
    Coordinates whole = step;
    for (Real& entry : whole) entry *= part;
    at.pose = moved(robot.mobility, base, whole);
  }
};
}  // namespace

Outcome fuse(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
             const PoseRows& H_x, Fusion& fusion) {
  const int n = dof(robot.mobility), rows = readings(robot);
  PoseRows A = H_x;
  const Ldlt equations = normal_equations(robot, known, C, A, fusion.covariance);
  if (!equations.regular()) return {Status::singular};
  for (int c : range(rows)) {
    Coordinates column = A[c];
    equations.solve(column);
    for (int i : range(n)) fusion.gain[i][c] = column[i];
  }
  for (int i : range(n)) {  // times L⁻¹, from the right
    C.colour(rows, fusion.gain[i].data());
    for (int c : range(rows)) fusion.gain[i][c] /= known.sigma[c];
  }
  return {};
}

Real chi2(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
          const Extended& q_e, const Extended& expected, Extended& white) {
  const int rows = readings(robot);
  innovation(robot, q_e, expected, white);
  for (int c : range(rows)) white[c] /= known.sigma[c];
  C.whiten(rows, white.data(), 1);
  return sum_of(rows, [&](int c) { return white[c] * white[c]; });
}

Estimate search(Level level, const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
                const Extended& q_e, Expected& at, Parasitic& rest, int done, int cap) {
  const bool counted = rest.left != kUncounted;
  Search found{robot, known, C, at};
  Outcome outcome;
  int iterations = done;
  for (; outcome; ++iterations) {
    const Real next = chi2(robot, known, C, q_e, at.q_e, found.white), last = found.size;
    const bool whole = found.length == 1;
    outcome.status = isfinite(next) ? Status::ok : Status::not_converged;
    if (outcome && !found.shorten(next)) {
      outcome = found.turn(next);
      const bool late = is_late(found.size, iterations, counted);
      if (outcome && (late || is_last(found.size, last, found.cost, found.rows, whole))) {
        found.go(1);
        const Real left = max(found.cost - found.promised, Real(0));
        return {{}, iterations + 1, left, found.covariance};
      }
    }
    if (!outcome) break;
    const bool spent = rest.most(true) < 1 && found.cost < kPlausible * found.rows;
    if ((spent || iterations == kEstimateIterations) && max(found.promised, found.size) < kFlat) {
      found.go(spent ? found.length : 0);
      return {{}, iterations, found.cost, found.covariance};
    }
    found.go(found.length);
    const bool goes_on = all_finite(found.step, found.n) && iterations < cap;
    outcome = goes_on ? linearise(level, robot, at.pose, at.q_e, at.H_x, nullptr, &rest)
                      : Outcome{Status::not_converged};
    if (outcome.status == Status::unreachable)  // of this step's pose, not of the readings
      outcome = {Status::not_converged};
  }
  return {outcome, iterations};
}

Estimate estimate(Level level, const Robot& robot, const Knowledge& known, const Extended& q_e,
                  Pose& pose, Real* work) {
  if (!robot.finished) return {{Status::unfinished}};
  if (!all_finite(q_e, readings(robot))) return {{Status::not_finite}};
  Real *H_xi = work, *B = work ? work + readings(robot) * parameter_count(robot) : nullptr;
  Expected at{pose, {}, {}};
  Parasitic rest;
  const Status motors = motors_pose(level, robot, motors_of(robot, q_e), at.pose, rest);
  if (motors != Status::ok && motors != Status::not_converged) at.pose = pose;
  ReadingCovariance C;
  Outcome outcome = linearise(level, robot, at.pose, at.q_e, at.H_x, H_xi, &rest);
  if (outcome) outcome = reading_covariance(robot, known, H_xi, B, C);
  if (!outcome) return {outcome};
  const Estimate found = search(level, robot, known, C, q_e, at, rest, 0, kEstimateIterations);
  if (found) pose = at.pose;
  return found;
}

void weighted_tej(const Robot& robot, const PoseRows& H_x, const Fusion& fusion,
                  ExtendedRows& M_plus) {
  for (int i : range(robot.motors))
    for (int c : range(readings(robot)))
      M_plus[i][c] =
          sum_of(dof(robot.mobility), [&](int j) { return H_x[i][j] * fusion.gain[j][c]; });
}
}  // namespace truepose
