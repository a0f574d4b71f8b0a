// One row of readings as linear equations in ξ, with its pose eliminated.
#include "calibration/line.hpp"

#include "estimation/linearise.hpp"

namespace truepose {
double Line::chi2() const {
  return sum_of(redundancy(), [&](int i) { return e[n + i] * e[n + i]; });
}

double Line::misfit() const {
  return sum_of(rows, [&](int i) {
    const double off = i < n ? e[i] + pull[i] : e[i];
    return off * off;
  });
}

double Line::away() const {
  double size = 0;
  for (int i : range(n)) size = max(size, fabs(e[i] + pull[i]));
  return size;
}

double Line::cost(const RowLoss& loss) const {
  return outlier ? 0 : certain ? d2() : loss.cost(d2(), redundancy());
}

double Line::weight(const RowLoss& loss) const {
  return outlier ? 0 : certain ? 1 : loss.weight(d2(), redundancy());
}

double Line::left_out(const RowMatrix& root) const {
  const int m = redundancy();
  if (m == 0) return 0;
  RowMatrix V = transposed(RowMatrix(m, B.cols(), B[n]));
  solve_lower(root, V);
  // Covariance of e; at least 1e-6, above rounding where the row alone determines u.
  RowMatrix G = sum(RowMatrix::identity(m), transposed(V) * V, outlier ? 1 : -1);
  for (int i = 0; i < m; ++i) G(i, i) += 1e-6;
  const std::vector<double> own(e.begin() + n, e.begin() + rows);
  return dot(m, own.data(), solve_cholesky(cholesky(G), own).data());
}

Outcome acting(const Robot& robot, const Knowledge& axes, const Pose& pose, const Influences& given,
               double* H_xi, RowMatrix& D) {
  const int readings = truepose::readings(robot), size = readings * parameter_count(robot);
  D = RowMatrix(readings, given.count + axes.count);
  for (int c : range(readings))
    for (int j : range(given.count)) D(c, j) = given.pattern[c * given.count + j] / axes.sigma[c];
  if (axes.count == 0) return {};
  Extended q_e;
  PoseRows H_x;
  Outcome outcome = linearise(Level::full, robot, pose, q_e, H_x, H_xi);
  if (outcome) outcome = linearise(Level::ideal, robot, pose, q_e, H_x, H_xi + size);
  if (!outcome) return outcome;
  for (int k : range(size)) H_xi[k] -= H_xi[size + k];
  for (int c : range(readings)) gather_row(robot, axes, axes.count, H_xi, c, D[c] + given.count);
  return {};
}

Outcome linearise_line(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                       const double* q_e, Outside outside, const RowMatrix& D, double* H_xi,
                       Line& line, Parasitic& rest) {
  const int n = dof(robot.mobility), readings = truepose::readings(robot), p = known.count;
  line.B = RowMatrix(readings + (outside.x ? n : 0), p);
  const Outcome outcome =
      linearise_row(level, robot, known, pose, q_e, H_xi, line.B.data(), line, rest);
  if (!outcome) return outcome;
  for (int i : range(line.rows))
    std::copy_n(D[line.reading[i]], D.cols(), line.B[i] + p - D.cols());
  if (outside.x) {  // depends on the pose only
    Seen by = seen(robot.mobility, *outside.registration, pose);
    Coordinates apart = innovation(robot.mobility, by, outside.x);
    in_turns(robot.mobility, *outside.registration, pose, by, apart);
    for (int i : range(n)) {
      if (!isfinite(apart[i])) continue;
      for (int j = 0; j < kRegistration && outside.first >= 0; ++j)
        line.B(line.rows, outside.first + j) = by.H[i][j] / outside.sigma[i];
      for (int j : range(n)) line.R[line.rows][j] = by.H_x[i][j] / outside.sigma[i];
      line.e[line.rows++] = apart[i] / outside.sigma[i];
    }
  }
  times_root(known, line.rows, line.B.data());
  const bool determined =
      line.rows >= n && eliminate(n, line.rows, line.R, line.B.data(), p, line.e);
  return {determined ? Status::ok : Status::singular};
}
}  // namespace truepose
