// One row of readings as linear equations in ξ, with its pose eliminated.
#pragma once

#include "truepose/math/eliminate.hpp"
#include "truepose/offline/kernel_table.hpp"
#include "truepose/offline/loss.hpp"
#include "truepose/offline/registration.hpp"

namespace truepose {
/// A row of readings, linearised: R δx = e - B δu in the upper n equations; those below contain no
/// δx. In units of the readings' σ and, for u, of the knowledge's root: ξ = μ + S u.
struct Line {
  int n = 0, rows = 0;
  RowsOfPose R;
  std::array<double, kMaxRows> e;
  RowMatrix B;
  Coordinates pull{};  ///< from other data on the pose (links.hpp): its best is at e = -pull

  bool certain = false;  ///< never an outlier: its pose is known

  int redundancy() const { return std::max(rows - n, 0); }
  double chi2() const {
    return sum_of(redundancy(), [&](int i) { return e[n + i] * e[n + i]; });
  }
  /// Squared residual at its pose; chi2() is that of the best pose, to first order.
  double misfit() const {
    return sum_of(rows, [&](int i) {
      const double off = i < n ? e[i] + pull[i] : e[i];
      return off * off;
    });
  }
  /// Distance of its pose from the best pose, in units of its σ.
  double away() const {
    double size = 0;
    for (int i = 0; i < n; ++i) size = std::max(size, std::fabs(e[i] + pull[i]));
    return size;
  }
  /// Within σ of the best pose chi2() is exact enough; misfit() would add the pose's lag behind ξ,
  /// which hides the gain of a step where σ is small and steps are not.
  double d2() const { return away() < 1 ? chi2() : misfit(); }
  double cost(const LineLoss& loss) const { return certain ? d2() : loss.cost(d2(), redundancy()); }
  double weight(const LineLoss& loss) const {
    return certain ? 1 : loss.factor(d2(), redundancy());
  }
};

/// Registration of a tracker that measures x in the base frame.
inline const Registration kAligned{};

/// External measurement at a row's pose: some coordinates, the others NaN.
struct Outside {
  const double* x = nullptr;      ///< n coordinates; nullptr: none
  const double* sigma = nullptr;  ///< n, > 0
  const Registration* registration = &kAligned;
  int first = -1;  ///< of the registration among the unknowns, independent in S; -1: known
};

/// Other influences on the readings at a pose, of unknown amounts.
struct Influences {
  int count = 0;
  const double* pattern = nullptr;  ///< (n + r) × count: effect of one unit of each
};

/// Computes D of a row, in σ of the readings: of influences, then of nuisances (as left_out).
inline Outcome acting(const Kernels& kernels, const Robot& robot, const Knowledge& axes,
                      const Pose& pose, const Influences& given, double* H_xi, RowMatrix& D) {
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

/// Linearises readings and external measurement at a pose, and eliminates the pose.
/// @param q_e    n + r readings, NaN where missing; nullptr: as expected
/// @param known  ξ, then unknowns that no reading depends on, column -1, then η if D is given
/// @param D      ∂q_e/∂η in units of the readings' σ, from acting; nullptr: no η
/// @param H_xi   work space, 2 (n + r) × parameter_count. @param rest  as for ikm_full
inline Outcome linearise_line(const Kernels& kernels, const Robot& robot, const Knowledge& known,
                              const Pose& pose, const double* q_e, Outside outside,
                              const RowMatrix* D, double* H_xi, Line& line, Parasitic& rest) {
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
