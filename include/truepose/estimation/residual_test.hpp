// Residual tests of one row of readings: contradiction, its isolation, its duration.
//
// Eliminating the pose leaves r equations F ζ = y: ζ has unit variance (δξ = S ζ), each equation
// noise. Testing them together detects an error in any mixture of them: yᵀ(R + F Fᵀ)⁻¹y is χ² with
// r degrees of freedom. An unknown error b of one reading adds b g to y, g its column of the same
// equations: allowing for it lowers χ² by (gᵀC⁻¹y)²/(gᵀC⁻¹g) (the generalised likelihood ratio). No
// single row shows a small persistent fault: Page's CUSUM adds up how much likelier the rows are
// with twice the stated errors than with these (Page, Continuous Inspection Schemes, 1954).
#pragma once

#include "truepose/math/eliminate.hpp"

namespace truepose {
inline constexpr Real kGate = 4;   ///< σ: excludes 6 of 1e5 clean rows
inline constexpr Real kWorse = 4;  ///< variance of disagreeing readings over the stated one
/// Largest contribution of a row: one gross row must not stop the filter, six in a row must.
inline constexpr Real kLineSays = 3;
inline constexpr Real kStop = 16;  ///< at most one false stop in e¹⁶ clean rows (Lorden's bound)
inline constexpr Real kNamed = 2;  ///< rows more in which one reading must be faulty than any other
inline constexpr int kEvery = 4;   ///< rows between saved states

/// Disagreement of the readings of the last rows. Plain data.
struct ResidualTest {
  Real evidence = 0;     ///< log of the likelihood ratio since it was last 0
  Extended blame{};      ///< rows since then in which each reading alone was faulty
  bool stopped = false;  ///< identification has stopped
  int suspect = -1;      ///< reading that explains it best; -1: not unique
  long lines = 0;        ///< rows until it stopped
  int since = 0;         ///< rows since a state was saved
};

/// χ² of `count` degrees of freedom as unlikely as a normal variable beyond `gate` σ: its root is
/// within t of √count like a single one's within t of 1 (concentration of measure).
inline Real beyond(Real gate, int count) {
  const Real root = gate - 1 + std::sqrt(Real(count));
  return root * root;
}

/// r equations, each made independent of those before.
struct Innovations {
  int r = 0;
  Matrix<kMaxSensors, kMaxSensors> L;          ///< coefficients on the equations before
  std::array<Real, kMaxSensors> y;             ///< independent
  std::array<Real, kMaxSensors> noise, total;  ///< their variances: own; with the parameters'

  Real chi2() const {
    return sum_of(r, [&](int i) { return y[i] * y[i] / total[i]; });
  }
};

/// Decorrelates the equations F ζ = y: each is as after the filter's update by those before.
/// @param F  in: r×p; out: its row i belongs to the root after i updates (Carlson's form)
/// @param curvature  second-order remainder over the square of the loop residual
inline void decorrelate(int p, Real* F, Real curvature, Innovations& line) {
  for (int i = 0; i < line.r; ++i) {
    const Real* f = F + i * p;
    const Real open = sum_of(p, [&](int j) { return f[j] * f[j]; });
    const Real curved = curvature * open;
    line.noise[i] = 1 + curved * curved;
    line.total[i] = line.noise[i] + open;
    for (int k = i + 1; k < line.r; ++k) {
      Real *other = F + k * p, sum = 0, before = line.noise[i];
      for (int j = p - 1; j >= 0; --j) {
        const Real alpha = before + f[j] * f[j], old = other[j];
        other[j] = std::sqrt(before / alpha) * (old - f[j] / before * sum);
        sum += f[j] * old;
        before = alpha;
      }
      line.L[k][i] = sum / line.total[i];
      line.y[k] -= line.L[k][i] * line.y[i];
    }
  }
}

/// Decrease of χ² for each reading taken as faulty.
/// @param A  H_x, whitened, as before `eliminate`; overwritten
inline bool explained(int n, RowsOfPose& A, const Innovations& line, Extended& by) {
  const int rows = n + line.r;
  std::array<Real, kMaxRows * kMaxRows> unit{};
  std::array<Real, kMaxRows> none{};
  for (int c = 0; c < rows; ++c) unit[c * rows + c] = 1;
  if (!eliminate(n, rows, A, unit.data(), rows, none)) return false;
  for (int c = 0; c < rows; ++c) {
    Real score = 0, information = 0;
    std::array<Real, kMaxSensors> g;
    for (int i = 0; i < line.r; ++i) {
      g[i] = unit[(n + i) * rows + c];
      for (int k = 0; k < i; ++k) g[i] -= line.L[i][k] * g[k];
      score += g[i] * line.y[i] / line.total[i];
      information += g[i] * g[i] / line.total[i];
    }
    by[c] = information > kSingular ? score * score / information : 0;
  }
  return true;
}

/// Index of the entry that exceeds all others by more than `margin`, or -1.
inline int outstanding(int count, const Extended& value, Real margin) {
  const auto end = value.begin() + count;
  const auto most = std::max_element(value.begin(), end);
  for (auto other = value.begin(); other != end; ++other)
    if (other != most && *other > *most - margin) return -1;
  return static_cast<int>(most - value.begin());
}
}  // namespace truepose
