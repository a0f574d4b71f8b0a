#include "calibration/line.hpp"

namespace truepose {
Outcome acting(const Kernels& kernels, const Robot& robot, const Knowledge& axes, const Pose& pose,
               const Influences& given, double* H_xi, RowMatrix& D) {
  const int readings = kernels.n + robot.r;
  RowMatrix left(readings, 0);
  Outcome outcome;
  if (axes.count > 0) outcome = left_out(robot, axes, pose, H_xi, left);
  D.resize(readings, given.count + left.cols());
  for (int c = 0; c < readings && outcome; ++c) {
    for (int j = 0; j < given.count; ++j)
      D(c, j) = given.pattern[c * given.count + j] / axes.sigma[c];
    D.row(c).tail(left.cols()) = left.row(c);
  }
  return outcome;
}

Outcome linearise_line(const Kernels& kernels, const Robot& robot, const Knowledge& known,
                       const Pose& pose, const double* q_e, Outside outside, const RowMatrix* D,
                       double* H_xi, Line& line, Parasitic& rest) {
  const int n = kernels.n, readings = n + robot.r;
  Extended expected, residual{}, values{};
  PoseRows H_x;
  const Outcome outcome = kernels.linearise(robot, pose, expected, H_x, H_xi, rest);
  if (!outcome) return outcome;
  if (q_e) {
    std::copy_n(q_e, readings, values.begin());
    innovation(robot, values, expected, residual);
  }
  line.n = n;
  line.rows = 0;
  // After ξ: auxiliary unknowns, on which these readings do not depend, and nuisances.
  const long last = D ? D->cols() : 0;
  const int others =
      static_cast<int>(std::count(known.column, known.column + known.count - last, -1) + last);
  line.B.resize(readings + (outside.x ? n : 0), known.count);
  gather(robot, known, H_xi, readings, line.B.data(), others);
  line.B.topRightCorner(readings, others).setZero();
  if (D) line.B.topRightCorner(readings, D->cols()) = *D;
  times_root(known, readings, line.B.data());
  const auto enter = [&](double e, double sigma, auto&& H) {
    for (int j = 0; j < n; ++j) line.R[line.rows][j] = H(j) / sigma;
    line.e[line.rows++] = e / sigma;
  };
  for (int c = 0; c < readings; ++c) {
    if (!std::isfinite(residual[c])) continue;
    if (line.rows < c) line.B.row(line.rows) = line.B.row(c);
    enter(residual[c], known.sigma[c], [&](int j) { return H_x[c][j]; });
  }
  if (outside.x) {  // depends on the pose only
    Seen by = seen(kernels.mobility, *outside.registration, pose);
    Coordinates apart = innovation(kernels.mobility, by, outside.x);
    in_turns(kernels.mobility, *outside.registration, pose, by, apart);
    for (int i = 0; i < n; ++i) {
      if (!std::isfinite(apart[i])) continue;
      auto row = line.B.row(line.rows);
      row.setZero();
      for (int j = 0; j < kRegistration && outside.first >= 0; ++j) {
        const int at = outside.first + j;
        const double unit = known.root ? known.root[at * (known.count + 1)] : 1;
        row[at] = by.H[i][j] * unit / outside.sigma[i];
      }
      enter(apart[i], outside.sigma[i], [&](int j) { return by.H_x[i][j]; });
    }
  }
  const bool determined =
      line.rows >= n && eliminate(n, line.rows, line.R, line.B.data(), known.count, line.e);
  return {determined ? Status::ok : Status::singular, -1};
}
}  // namespace truepose
