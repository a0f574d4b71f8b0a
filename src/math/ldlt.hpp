// LDLᵀ of a small symmetric system, for the FKM, J, the TEJ and the dynamics.
#pragma once

#include <array>

#include "math/real.hpp"

namespace truepose {
/// Below this a pivot counts as zero: for A = JᵀJ, a column of J within 1e-6 rad (single precision:
/// 1e-3) of the span of the preceding ones.
inline constexpr Real kSingular = by_precision(1e-12, 1e-6);

/// LDLᵀ of a symmetric positive definite n×n matrix; only the lower triangle is read.
class Ldlt {
 public:
  /// Factorises A, rows of `stride`. size[j] is what A[j][j] would be without cancellation: the
  /// unit of pivot j, which makes the test of singularity independent of metres and radians.
  Ldlt(int n, const Real* A, int stride, const Real* size) : n_(n) {
    for (int j = 0; j < n; ++j) {  // so written, gcc sees what is initialised
      const Real* row = A + j * stride;
      Real pivot = row[j], scaled[kMaxUnknowns];  // scaled: row j of L D
      for (int k = 0; k < j; ++k) {
        scaled[k] = l_[j][k] * d_[k];
        pivot -= l_[j][k] * scaled[k];
      }
      regular_ = regular_ && pivot > kSingular * size[j];  // false for a NaN
      d_[j] = pivot;
      inverse_[j] = 1 / pivot;
      for (int i = j + 1; i < n; ++i) {
        Real sum = A[i * stride + j];
        for (int k = 0; k < j; ++k) sum -= l_[i][k] * scaled[k];
        l_[i][j] = sum * inverse_[j];
      }
    }
  }
  /// The same for a matrix of fixed capacity.
  template <class Matrix, class Size>
  Ldlt(int n, const Matrix& A, const Size& size)
      : Ldlt(n, A[0].data(), int(A[0].size()), size.data()) {}

  /// Whether A has full rank.
  bool regular() const { return regular_; }

  /// Solves A x = b in place.
  template <class Vector>
  void solve(Vector& b) const {
    for (int i : range(1, n_))
      for (int k : range(i)) b[i] -= l_[i][k] * b[k];
    for (int i : range(n_)) b[i] *= inverse_[i];
    for (int i = n_ - 2; i >= 0; --i)
      for (int k : range(i + 1, n_)) b[i] -= l_[k][i] * b[k];
  }

 private:
  int n_;
  Real l_[kMaxUnknowns][kMaxUnknowns];
  Real d_[kMaxUnknowns], inverse_[kMaxUnknowns];
  bool regular_ = true;
};
}  // namespace truepose
