// Residual tests of one row of readings: contradiction, its isolation, its duration.
//
// Eliminating the pose leaves r equations (with m > n motors m - n + r) F ζ = y: ζ has unit
// variance (δξ = S ζ), each equation noise. Testing them together detects an error in any mixture
// of them: yᵀ(R + F Fᵀ)⁻¹y is χ² with r degrees of freedom. An unknown error b of one reading adds
// b g to y, g its column of the same equations: allowing for it lowers χ² by (gᵀC⁻¹y)²/(gᵀC⁻¹g)
// (the generalised likelihood ratio). No single row shows a small persistent fault: Page's CUSUM
// adds up how much likelier the rows are with twice the stated errors than with these (Page,
// Continuous Inspection Schemes, 1954).
#pragma once

#include "math/eliminate.hpp"

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
  Matrix<kMaxReadings, kMaxReadings> L;         ///< coefficients on the equations before
  std::array<Real, kMaxReadings> y;             ///< independent
  std::array<Real, kMaxReadings> noise, total;  ///< their variances: own; with the parameters'

  Real chi2() const {
    return sum_of(r, [&](int i) { return y[i] * y[i] / total[i]; });
  }
};

/// Decorrelates the equations F ζ = y: each is as after the filter's update by those before.
/// @param F  in: r×p; out: its row i belongs to the root after i updates (Carlson's form)
/// @param curvature  second-order remainder over the square of the loop residual
void decorrelate(int p, Real* F, Real curvature, Innovations& line);

/// Rows as `eliminate` leaves them, by an error of one σ of each reading. @param G  rows × rows
bool of_readings(int n, int rows, RowsOfPose& A, Real* G);

/// Decrease of χ² for each reading taken as faulty.
/// @param A  H_x, whitened, as before `eliminate`; overwritten
bool explained(int n, RowsOfPose& A, const Innovations& line, Extended& by);

/// Index of the entry that exceeds all others by more than `margin`, or -1.
int outstanding(int count, const Extended& value, Real margin);
}  // namespace truepose
