// Solution of a small system, square or in least squares: Newton's step, the columns of J, the sign
// of det J_x.
#pragma once

#include <algorithm>
#include <utility>

#include "math/ldlt.hpp"

namespace truepose {
/// Rows of a small matrix, or of its inverse.
using Square = std::array<std::array<Real, kMaxUnknowns>, kMaxUnknowns>;
using Unknowns = std::array<Real, kMaxUnknowns>;

/// Solves (AᵀA + damping · diag(size)) x = Aᵀ b, A rows×n: least squares, Levenberg's damped steps.
class NormalEquations {
 public:
  NormalEquations(int rows, int n, const Square& a, const Unknowns& size, Real damping = 0)
      : rows_(rows), n_(n), a_(a), factor_(n, normal(rows, n, a, size, damping), size) {}
  bool regular() const { return factor_.regular(); }

  template <class Vector>
  Unknowns solve(const Vector& b) const {
    Unknowns x{};
    for (int k = 0; k < rows_; ++k)
      for (int j = 0; j < n_; ++j) x[j] += a_[k][j] * b[k];
    factor_.solve(x);
    return x;
  }

  /// Column j of the solution operator, times scale.
  Unknowns column(int j, Real scale) const {
    Unknowns x;
    for (int i = 0; i < n_; ++i) x[i] = scale * a_[j][i];
    factor_.solve(x);
    return x;
  }

 private:
  static Square normal(int rows, int n, const Square& a, const Unknowns& size, Real damping) {
    Square result;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j) {
        Real sum = 0;
        for (int k = 0; k < rows; ++k) sum += a[k][i] * a[k][j];
        result[i][j] = sum;
      }
      result[i][i] += damping * size[i];
    }
    return result;
  }

  int rows_, n_;
  const Square& a_;
  Ldlt factor_;
};

/// Result of an inversion.
struct Inverted {
  bool regular = false;  ///< A has full rank
  int sign = 0;          ///< of det A; damped or not square: 0
  explicit operator bool() const { return regular; }
};

/// A⁻¹ by rows: by the adjugate up to 4×4, else by elimination; A⁺ = (AᵀA)⁻¹Aᵀ where A has more
/// rows than columns.
///
/// size[j] is what |column j|² would be without cancellation: the unit that makes the test of
/// singularity independent of metres and radians.
/// damping > 0: Levenberg's (AᵀA + damping · diag(size))⁻¹Aᵀ replaces A⁻¹.
Inverted invert(int rows, int n, const Square& a, const Unknowns& size, Real damping,
                Square& inverse);

/// Sign of the determinant, -1, 0 or 1, by elimination with pivoting.
int determinant_sign(int n, const Square& a);
}  // namespace truepose
