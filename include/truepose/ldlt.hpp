// How is a small symmetric system solved? One LDLᵀ for the FKM, J, the TEJ and the dynamics.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

namespace truepose {

/// Below this a pivot counts as zero: for A = JᵀJ a column of J within 1e-6 rad of the span of the
/// ones before it.
inline constexpr double kSingular = 1e-12;

/// LDLᵀ of a symmetric positive definite N×N matrix, of which only the lower triangle is read.
/// N is a compile-time size: the loops unroll and nothing is allocated.
template <int N>
class Ldlt {
 public:
  /// Factorises A. size[j] is what A[j][j] would be if nothing in it cancelled: it gives the unit
  /// in which the pivots are judged, so that neither metres nor radians matter.
  Ldlt(const std::array<std::array<double, N>, N>& A, const std::array<double, N>& size) {
    for (int j = 0; j < N; ++j) {
      double pivot = A[j][j], scaled[N];  // scaled: row j of L D
      for (int k = 0; k < j; ++k) {
        scaled[k] = l_[j][k] * d_[k];
        pivot -= l_[j][k] * scaled[k];
      }
      regular_ = regular_ && pivot > kSingular * size[j];  // false for a NaN
      d_[j] = pivot;
      inverse_[j] = 1 / pivot;
      for (int i = j + 1; i < N; ++i) {
        double sum = A[i][j];
        for (int k = 0; k < j; ++k) sum -= l_[i][k] * scaled[k];
        l_[i][j] = sum * inverse_[j];
      }
    }
  }

  /// Whether A has full rank.
  bool regular() const { return regular_; }

  /// Solves A x = b in place.
  template <class Vector>
  void solve(Vector& b) const {
    for (int i = 1; i < N; ++i)
      for (int k = 0; k < i; ++k) b[i] -= l_[i][k] * b[k];
    for (int i = 0; i < N; ++i) b[i] *= inverse_[i];
    for (int i = N - 2; i >= 0; --i)
      for (int k = i + 1; k < N; ++k) b[i] -= l_[k][i] * b[k];
  }

 private:
  double l_[N][N];
  double d_[N], inverse_[N];
  bool regular_ = true;
};

/// Sign of the determinant, -1, 0 or 1: up to 4×4 by minors, which need no branch; above by
/// elimination with partial pivoting.
template <int N, class SquareMatrix>
inline int determinant_sign(const SquareMatrix& A) {
  if constexpr (N <= 4) {
    double determinant;
    const auto minor = [&](int row, int i, int j) {
      return A[row][i] * A[row + 1][j] - A[row][j] * A[row + 1][i];
    };
    if constexpr (N == 2)
      determinant = minor(0, 0, 1);
    else if constexpr (N == 3)
      determinant = A[0][0] * minor(1, 1, 2) - A[0][1] * minor(1, 0, 2) + A[0][2] * minor(1, 0, 1);
    else  // Laplace expansion by the first two rows
      determinant = minor(0, 0, 1) * minor(2, 2, 3) - minor(0, 0, 2) * minor(2, 1, 3) +
                    minor(0, 0, 3) * minor(2, 1, 2) + minor(0, 1, 2) * minor(2, 0, 3) -
                    minor(0, 1, 3) * minor(2, 0, 2) + minor(0, 2, 3) * minor(2, 0, 1);
    return (determinant > 0) - (determinant < 0);
  }
  double m[N][N];
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) m[i][j] = A[i][j];
  int sign = 1;
  for (int k = 0; k < N; ++k) {
    int best = k;
    for (int i = k + 1; i < N; ++i)
      if (std::fabs(m[i][k]) > std::fabs(m[best][k])) best = i;
    if (m[best][k] == 0) return 0;
    if (best != k) {
      std::swap_ranges(&m[k][0], &m[k][0] + N, &m[best][0]);
      sign = -sign;
    }
    if (m[k][k] < 0) sign = -sign;
    for (int i = k + 1; i < N; ++i) {
      const double factor = m[i][k] / m[k][k];
      for (int j = k + 1; j < N; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  return sign;
}

}  // namespace truepose
