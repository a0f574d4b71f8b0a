// How is a small symmetric system solved? One LDLᵀ for the FKM, J, the TEJ and the dynamics.
#pragma once

#include <algorithm>
#include <cmath>

namespace truepose {

/// LDLᵀ of a symmetric positive definite N×N matrix, of which only the lower triangle is read.
/// N is a compile-time size: the loops unroll and nothing is allocated.
template <int N>
class Ldlt {
 public:
  /// Factorises A. `determinacy()` is then the smallest ratio of a pivot to its diagonal entry:
  /// for A = JᵀJ the squared sine of the angle between a column of J and the ones before it,
  /// whatever the columns' units. Zero means rank deficient.
  template <class SquareMatrix>
  explicit Ldlt(const SquareMatrix& A) {
    determinacy_ = 1;
    for (int j = 0; j < N; ++j) {
      double pivot = A[j][j], scaled[N]{};  // scaled: row j of L D
      for (int k = 0; k < j; ++k) {
        scaled[k] = l_[j][k] * d_[k];
        pivot -= l_[j][k] * scaled[k];
      }
      d_[j] = pivot;
      inverse_[j] = 1 / pivot;
      for (int i = j + 1; i < N; ++i) {
        double sum = A[i][j];
        for (int k = 0; k < j; ++k) sum -= l_[i][k] * scaled[k];
        l_[i][j] = sum * inverse_[j];
      }
      const double ratio = pivot / A[j][j];  // a NaN counts as zero
      determinacy_ = ratio < determinacy_ ? ratio : (ratio >= determinacy_ ? determinacy_ : 0);
    }
  }

  double determinacy() const { return determinacy_; }

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
  double determinacy_;
};

/// Below this a matrix JᵀJ counts as singular: a column of J within 1e-6 rad of the others' span.
inline constexpr double kSingular = 1e-12;

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
