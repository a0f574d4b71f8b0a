// LDLᵀ of a small symmetric system, for the FKM, J, the TEJ and the dynamics.
#pragma once

#include <array>
#include <cmath>

#include "truepose/math/real.hpp"

namespace truepose {
/// Below this a pivot counts as zero: for A = JᵀJ, a column of J within 1e-6 rad (single precision:
/// 1e-3) of the span of the preceding ones.
inline constexpr Real kSingular = by_precision(1e-12, 1e-6);

/// LDLᵀ of a symmetric positive definite N×N matrix; only the lower triangle is read. N is a
/// compile-time size: loops unroll and nothing is allocated.
template <int N>
class Ldlt {
 public:
  /// Factorises A. size[j] is what A[j][j] would be without cancellation: the unit of pivot j,
  /// which makes the test of singularity independent of metres and radians.
  Ldlt(const std::array<std::array<Real, N>, N>& A, const std::array<Real, N>& size) {
    for (int j = 0; j < N; ++j) {
      Real pivot = A[j][j], scaled[N];  // scaled: row j of L D
      for (int k = 0; k < j; ++k) {
        scaled[k] = l_[j][k] * d_[k];
        pivot -= l_[j][k] * scaled[k];
      }
      regular_ = regular_ && pivot > kSingular * size[j];  // false for a NaN
      d_[j] = pivot;
      inverse_[j] = 1 / pivot;
      for (int i = j + 1; i < N; ++i) {
        Real sum = A[i][j];
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
  Real l_[N][N];
  Real d_[N], inverse_[N];
  bool regular_ = true;
};
}  // namespace truepose
