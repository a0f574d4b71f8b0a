// One row of readings as linear equations in ξ, with its pose eliminated.
#include "calibration/line.hpp"

#include "calibration/model_error.hpp"

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
  for (int i = 0; i < n; ++i) size = std::max(size, std::fabs(e[i] + pull[i]));
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
  const int readings = truepose::readings(robot), count = given.count + axes.count;
  RowMatrix left;
  Outcome outcome;
  if (axes.count > 0) outcome = left_out(robot, axes, pose, H_xi, left);
  D = RowMatrix(readings, count);
  for (int c = 0; c < readings && outcome; ++c) {
    for (int j = 0; j < given.count; ++j)
      D(c, j) = given.pattern[c * given.count + j] / axes.sigma[c];
    std::copy_n(left[c], axes.count, D[c] + given.count);
  }
  return outcome;
}

Outcome linearise_line(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                       const double* q_e, Outside outside, const RowMatrix* D, double* H_xi,
                       Line& line, Parasitic& rest) {
  const int n = dof(robot.mobility), readings = truepose::readings(robot), p = known.count;
  Extended expected, residual{}, values{};
  PoseRows H_x;
  const Outcome outcome = linearise(level, robot, pose, expected, H_x, H_xi, &rest);
  if (!outcome) return outcome;
  if (q_e) {
    std::copy_n(q_e, readings, values.begin());
    innovation(robot, values, expected, residual);
  }
  line.n = n;
  line.rows = 0;
  // After ξ: auxiliary unknowns, on which these readings do not depend, and nuisances.
  const int last = D ? D->cols() : 0;
  const int others = static_cast<int>(std::count(known.column, known.column + p - last, -1)) + last;
  line.B = RowMatrix(readings + (outside.x ? n : 0), p);
  gather(robot, known, H_xi, readings, line.B.data(), others);
  for (int c = 0; c < readings && D; ++c) std::copy_n((*D)[c], last, line.B[c] + p - last);
  times_root(known, readings, line.B.data());
  const auto enter = [&](double e, double sigma, auto&& H) {
    for (int j = 0; j < n; ++j) line.R[line.rows][j] = H(j) / sigma;
    line.e[line.rows++] = e / sigma;
  };
  for (int c = 0; c < readings; ++c) {
    if (!std::isfinite(residual[c])) continue;
    if (line.rows < c) std::copy_n(line.B[c], p, line.B[line.rows]);
    enter(residual[c], known.sigma[c], [&](int j) { return H_x[c][j]; });
  }
  if (outside.x) {  // depends on the pose only
    Seen by = seen(robot.mobility, *outside.registration, pose);
    Coordinates apart = innovation(robot.mobility, by, outside.x);
    in_turns(robot.mobility, *outside.registration, pose, by, apart);
    for (int i = 0; i < n; ++i) {
      if (!std::isfinite(apart[i])) continue;
      double* row = line.B[line.rows];
      std::fill_n(row, p, 0.0);
      for (int j = 0; j < kRegistration && outside.first >= 0; ++j) {
        const int at = outside.first + j;
        const double unit = known.root ? known.root[at * (p + 1)] : 1;
        row[at] = by.H[i][j] * unit / outside.sigma[i];
      }
      enter(apart[i], outside.sigma[i], [&](int j) { return by.H_x[i][j]; });
    }
  }
  const bool determined =
      line.rows >= n && eliminate(n, line.rows, line.R, line.B.data(), p, line.e);
  return {determined ? Status::ok : Status::singular, -1};
}
}  // namespace truepose
