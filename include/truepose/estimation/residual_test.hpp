// Residual tests of one row of readings: contradiction, its isolation, its duration.
//
// Once the pose is eliminated, r equations F ζ = y are left: ζ has unit variance (δξ = S ζ), each
// equation noise. Their mixture hides nothing when they are tested together: yᵀ(R + F Fᵀ)⁻¹y is χ²
// with r degrees of freedom. A reading that is wrong by an unknown b adds b g to y, g its column of
// the same equations: χ² falls by (gᵀC⁻¹y)²/(gᵀC⁻¹g) once it is believed to be (the generalised
// likelihood ratio). A line alone cannot betray a small fault that stays. Page's CUSUM adds up how
// much likelier the lines are with twice the errors stated than with those stated (Page, Continuous
// Inspection Schemes, 1954).
#pragma once

#include "truepose/math/eliminate.hpp"

namespace truepose {

inline constexpr Real kGate = 4;   ///< σ: leaves out 6 of 1e5 clean lines
inline constexpr Real kWorse = 4;  ///< variance of readings that disagree, over the stated one
/// At most, whatever it reads: one gross line must not stop the filter, six in a row must.
inline constexpr Real kLineSays = 3;
inline constexpr Real kStop = 16;  ///< one false stop in e¹⁶ clean lines at most (Lorden's bound)
inline constexpr Real kNamed = 2;  ///< lines: one must be more often guilty than any other by more
inline constexpr int kEvery = 4;   ///< lines between states that are kept

/// How far the readings of the last lines disagree. Plain data.
struct ResidualTest {
  Real evidence = 0;     ///< log of the likelihood ratio since it was last even
  Extended blame{};      ///< lines since then in which each reading alone was wrong
  bool stopped = false;  ///< nothing is learnt any more
  int suspect = -1;      ///< the reading that explains best why, -1: cannot be told
  long lines = 0;        ///< seen until it stopped
  int since = 0;         ///< lines since a state was kept
};

/// χ² of `count` degrees of freedom that is as unlikely as a normal variable beyond `gate` σ: its
/// root is within t of √count like a single one's within t of 1 (concentration of measure).
inline Real beyond(Real gate, int count) {
  const Real root = gate - 1 + std::sqrt(Real(count));
  return root * root;
}

/// r equations, one after another made independent of those before.
struct Innovations {
  int r = 0;
  Matrix<kMaxSensors, kMaxSensors> L;          ///< what an equation takes from those before
  std::array<Real, kMaxSensors> y;             ///< independent
  std::array<Real, kMaxSensors> noise, total;  ///< their variances: own; with what is open

  Real chi2() const {
    Real sum = 0;
    for (int i = 0; i < r; ++i) sum += y[i] * y[i] / total[i];
    return sum;
  }
};

/// The equations F ζ = y, one by one, each after the filter has learnt those before.
///
/// @param F  in: r×p; out: its row i belongs to the root after i updates (Carlson's form)
/// @param curvature  second-order remainder over the square of the loop residual
inline void decorrelate(int p, Real* F, Real curvature, Innovations& line) {
  for (int i = 0; i < line.r; ++i) {
    const Real* f = F + i * p;
    Real open = 0;
    for (int j = 0; j < p; ++j) open += f[j] * f[j];
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

/// By how much χ² falls for each reading that is taken to be wrong.
///
/// @param A  H_x, whitened, as before `eliminate`; spoilt
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

/// The entry that stands out from all others by more than `margin`, or -1.
inline int outstanding(int count, const Extended& value, Real margin) {
  const auto end = value.begin() + count;
  const auto most = std::max_element(value.begin(), end);
  for (auto other = value.begin(); other != end; ++other)
    if (other != most && *other > *most - margin) return -1;
  return static_cast<int>(most - value.begin());
}

}  // namespace truepose
