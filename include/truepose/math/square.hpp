// Solution of a small square system: Newton's step, the columns of J, the sign of det J_x.
#pragma once

#include <algorithm>
#include <utility>

#include "truepose/math/adjugate.hpp"
#include "truepose/math/ldlt.hpp"

namespace truepose {
/// Rows of a square matrix, or of its inverse.
using Square = std::array<std::array<Real, kMaxUnknowns>, kMaxUnknowns>;
using Unknowns = std::array<Real, kMaxUnknowns>;

/// Solves (AᵀA + damping · diag(size)) x = Aᵀ b: Levenberg's damped steps.
class NormalEquations {
 public:
  NormalEquations(int n, const Square& a, const Unknowns& size, Real damping = 0)
      : n_(n), a_(a), factor_(n, normal(n, a, size, damping), size) {}
  bool regular() const { return factor_.regular(); }

  template <class Vector>
  Unknowns solve(const Vector& b) const {
    Unknowns x{};
    for (int k = 0; k < n_; ++k)
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
  static Square normal(int n, const Square& a, const Unknowns& size, Real damping) {
    Square result;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j) {
        Real sum = 0;
        for (int k = 0; k < n; ++k) sum += a[k][i] * a[k][j];
        result[i][j] = sum;
      }
      result[i][i] += damping * size[i];
    }
    return result;
  }

  int n_;
  const Square& a_;
  Ldlt factor_;
};

/// Result of an inversion.
struct Inverted {
  bool regular = false;  ///< A has full rank
  int sign = 0;          ///< of det A; damped: 0
  explicit operator bool() const { return regular; }
};

namespace square_detail {
template <int N>
inline Inverted by_adjugate(const Square& a, const Unknowns& size, Square& inverse) {
  std::array<std::array<Real, N>, N> rows, b;
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) rows[i][j] = a[i][j];
  const Real determinant = adjugate<N>(rows, b), per_determinant = 1 / determinant;
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) inverse[i][j] = per_determinant * b[i][j];
  Real unit = kSingular;
  for (int j = 0; j < N; ++j) unit *= size[j];
  // false for a NaN
  return {determinant * determinant > unit, (determinant > 0) - (determinant < 0)};
}

/// Gauss-Jordan elimination, columns scaled to unit size, pivots by rows.
inline Inverted by_elimination(int n, const Square& a, const Unknowns& size, Square& inverse) {
  Square left;
  Unknowns scale;
  for (int j = 0; j < n; ++j) scale[j] = 1 / std::sqrt(size[j]);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      left[i][j] = a[i][j] * scale[j];
      inverse[i][j] = i == j;
    }
  Inverted result{true, 1};
  for (int k = 0; k < n; ++k) {
    int best = k;
    for (int i = k + 1; i < n; ++i)
      if (std::fabs(left[i][k]) > std::fabs(left[best][k])) best = i;
    if (best != k) {
      std::swap(left[k], left[best]);
      std::swap(inverse[k], inverse[best]);
      result.sign = -result.sign;
    }
    const Real pivot = left[k][k], per_pivot = 1 / pivot;
    result.regular = result.regular && pivot * pivot > kSingular;  // false for a NaN
    result.sign = pivot > 0 ? result.sign : pivot < 0 ? -result.sign : 0;
    for (int j = 0; j < n; ++j) {
      left[k][j] *= per_pivot;
      inverse[k][j] *= per_pivot;
    }
    for (int i = 0; i < n; ++i) {
      if (i == k) continue;
      const Real factor = left[i][k];
      for (int j = 0; j < n; ++j) {
        left[i][j] -= factor * left[k][j];
        inverse[i][j] -= factor * inverse[k][j];
      }
    }
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) inverse[i][j] *= scale[i];
  return result;
}
}  // namespace square_detail

/// A⁻¹ by rows: by the adjugate up to 4×4, else by elimination.
///
/// size[j] is what |column j|² would be without cancellation: the unit that makes the test of
/// singularity independent of metres and radians.
/// damping > 0: Levenberg's (AᵀA + damping · diag(size))⁻¹Aᵀ replaces A⁻¹.
inline Inverted invert(int n, const Square& a, const Unknowns& size, Real damping,
                       Square& inverse) {
  if (damping > 0) {
    const NormalEquations normal(n, a, size, damping);
    for (int j = 0; j < n; ++j) {
      const Unknowns column = normal.column(j, 1);
      for (int i = 0; i < n; ++i) inverse[i][j] = column[i];
    }
    return {normal.regular(), 0};
  }
  switch (n) {
    case 1: return square_detail::by_adjugate<1>(a, size, inverse);
    case 2: return square_detail::by_adjugate<2>(a, size, inverse);
    case 3: return square_detail::by_adjugate<3>(a, size, inverse);
    case 4: return square_detail::by_adjugate<4>(a, size, inverse);
    default: return square_detail::by_elimination(n, a, size, inverse);
  }
}

/// Sign of the determinant, -1, 0 or 1, by elimination with pivoting.
inline int determinant_sign(int n, Square m) {
  int sign = 1;
  for (int k = 0; k < n; ++k) {
    int best = k;
    for (int i = k + 1; i < n; ++i)
      if (std::fabs(m[i][k]) > std::fabs(m[best][k])) best = i;
    if (m[best][k] == 0) return 0;
    if (best != k) {
      std::swap(m[k], m[best]);
      sign = -sign;
    }
    if (m[k][k] < 0) sign = -sign;
    for (int i = k + 1; i < n; ++i) {
      const Real factor = m[i][k] / m[k][k];
      for (int j = k + 1; j < n; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  return sign;
}
}  // namespace truepose
