// The pose estimate from all readings together, and its covariance.
#include "estimation/estimate.hpp"

namespace truepose {
bool is_last(Real size, Real last, Real chi2, int rows) {
  // With σ of nanometres, rounding makes larger steps: below σ/1000 and hardly shrinking is enough.
  const Real enough =
      kLastStep * std::max(Real(1), chi2 / rows);  // of the residual that remains anyway
  return size < enough || (size < 1e-6 && size > 0.25 * last);
}

Real dot(int size, const Real* a, const Real* b) {
  Real sum[4] = {};
  int k = 0;
  for (; k + 4 <= size; k += 4)
    for (int j = 0; j < 4; ++j) sum[j] += a[k + j] * b[k + j];
  for (; k < size; ++k) sum[0] += a[k] * b[k];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

Outcome reading_covariance(const Robot& robot, const Knowledge& known, Real* B,
                           ReadingCovariance& C) {
  const int rows = readings(robot);
  times_root(known, rows, B);
  bool positive = true;
  for (int i = 0; i < rows; ++i) {
    positive = positive && known.sigma[i] > 0;
    for (int j = 0; j <= i; ++j)
      C.L[i][j] = (i == j) + dot(known.count, B + i * known.count, B + j * known.count);
  }
  return {positive && C.factor(rows) ? Status::ok : Status::not_finite, -1};
}

Real within_turn(const Robot& robot, int reading, Real difference) {
  const int m = robot.motors;
  if (reading < m) return within_turn(robot.chain[reading], difference);
  const Sensor& sensor = robot.sensor[reading - m];
  return properties(sensor.kind).wraps
             ? without_turns(difference, 2 * std::numbers::pi_v<Real> * sensor.gain)
             : difference;
}

Outcome fuse(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
             const PoseRows& H_x, Fusion& fusion) {
  const int n = dof(robot.mobility);
  const int rows = readings(robot);
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

Estimate estimate_from(Level level, const Robot& robot, const Knowledge& known, const Extended& q_e,
                       Pose& pose, Real* work, Parasitic& rest, int cap) {
  estimate_detail::Search search(robot, known, pose);
  Real *H_xi = work, *B = work ? work + search.rows * parameter_count(robot) : nullptr;
  const auto linearised = [&](Real* by_geometry) {
    return linearise(level, robot, search.at, search.expected, search.H_x, by_geometry, &rest);
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

void weighted_tej(const Robot& robot, const PoseRows& H_x, const Fusion& fusion,
                  ExtendedRows& M_plus) {
  for (int i = 0; i < robot.motors; ++i)
    for (int c = 0; c < readings(robot); ++c)
      M_plus[i][c] =
          sum_of(dof(robot.mobility), [&](int j) { return H_x[i][j] * fusion.gain[j][c]; });
}
}  // namespace truepose
