// Solution of a small square system: Newton's step, the columns of J, the sign of det J_x.
#pragma once

#include <algorithm>

#include "truepose/math/ldlt.hpp"
#include "truepose/math/six.hpp"

namespace truepose {
/// Rows of a matrix given by its columns.
template <int N>
inline Matrix<N, N> rows_of(const std::array<Lanes<N>, N>& columns) {
  Matrix<N, N> rows;
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) rows[i][j] = columns[j][i];
  return rows;
}

/// Sign of the determinant, -1, 0 or 1: by minors up to 4×4, else by elimination with pivoting.
template <int N>
inline int determinant_sign(std::array<std::array<Real, N>, N> m) {
  if constexpr (N <= 4) {
    std::array<std::array<Real, N>, N> unused;
    const Real determinant = adjugate<N>(m, unused);
    return (determinant > 0) - (determinant < 0);
  }
  int sign = 1;
  for (int k = 0; k < N; ++k) {
    int best = k;
    for (int i = k + 1; i < N; ++i)
      if (std::fabs(m[i][k]) > std::fabs(m[best][k])) best = i;
    if (m[best][k] == 0) return 0;
    if (best != k) {
      std::swap(m[k], m[best]);
      sign = -sign;
    }
    if (m[k][k] < 0) sign = -sign;
    for (int i = k + 1; i < N; ++i) {
      const Real factor = m[i][k] / m[k][k];
      for (int j = k + 1; j < N; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  return sign;
}

/// The same by columns; 6×6 by triples of rows where these are independent.
template <int N>
inline int determinant_sign(const std::array<Lanes<N>, N>& columns) {
  if constexpr (N == 6) {
    Matrix<6, 6> unused;
    const Real size = (columns[0].square() + columns[1].square() + columns[2].square()).mean();
    const Triples triples = invert_by_triples(columns, size, Lanes<6>::Ones(), unused);
    if (triples.independent) return (triples.determinant > 0) - (triples.determinant < 0);
  }
  return determinant_sign<N>(rows_of<N>(columns));
}

/// Solves (AᵀA + damping · diag(size)) x = Aᵀ b, for any size and Levenberg's damped steps.
template <int N>
class NormalEquations {
 public:
  using Vector = std::array<Real, N>;
  using Matrix = std::array<Vector, N>;

  NormalEquations(const Matrix& a, const Vector& size, Real damping = 0)
      : a_(a), factor_(normal(a, size, damping), size) {}
  bool regular() const { return factor_.regular(); }

  Vector solve(const Vector& b) const {
    Vector x{};
    for (int k = 0; k < N; ++k)
      for (int j = 0; j < N; ++j) x[j] += a_[k][j] * b[k];
    factor_.solve(x);
    return x;
  }

  /// Column j of the solution operator, times scale.
  Vector column(int j, Real scale) const {
    Vector x;
    for (int i = 0; i < N; ++i) x[i] = scale * a_[j][i];
    factor_.solve(x);
    return x;
  }

 private:
  static Matrix normal(const Matrix& a, const Vector& size, Real damping) {
    Matrix result;
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j <= i; ++j) {
        Real sum = 0;
        for (int k = 0; k < N; ++k) sum += a[k][i] * a[k][j];
        result[i][j] = sum;
      }
      result[i][i] += damping * size[i];
    }
    return result;
  }

  const Matrix& a_;
  Ldlt<N> factor_;
};

template <int N>
TRUEPOSE_RARE bool invert_by_normal_equations(const std::array<Lanes<N>, N>& columns,
                                              const std::array<Real, N>& size,
                                              const Lanes<N>& scale, Real damping,
                                              Matrix<N, N>& rows) {
  const Matrix<N, N> a = rows_of<N>(columns);
  const NormalEquations<N> normal(a, size, damping);
  for (int j = 0; j < N; ++j) {
    const std::array<Real, N> column = normal.column(j, scale[j]);
    for (int i = 0; i < N; ++i) rows[i][j] = column[i];
  }
  return normal.regular();
}

/// Result of an inversion.
struct Inverted {
  bool regular = false;  ///< A has full rank
  Real determinant = 0;  ///< det A, or a number of its sign; damped: 0
  explicit operator bool() const { return regular; }
};

/// A⁻¹ diag(scale) of a square matrix given by its columns: by the adjugate up to 4×4, 6×6 by
/// triples of rows, or by the normal equations where these are dependent.
///
/// size[j] is what |column j|² would be without cancellation: the unit that makes the test of
/// singularity independent of metres and radians.
/// damping > 0: Levenberg's (AᵀA + damping · diag(size))⁻¹Aᵀ replaces A⁻¹.
template <int N>
inline Inverted invert(const std::array<Lanes<N>, N>& columns, const std::array<Real, N>& size,
                       const Lanes<N>& scale, Real damping, Matrix<N, N>& rows) {
  if constexpr (N <= 4) {
    if (!(damping > 0)) {
      Matrix<N, N> b;
      const Real determinant = adjugate<N>(rows_of<N>(columns), b);
      const Real per_determinant = 1 / determinant;
      for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) rows[i][j] = b[i][j] * (per_determinant * scale[j]);
      Real unit = kSingular;
      for (int j = 0; j < N; ++j) unit *= size[j];
      return {determinant * determinant > unit, determinant};  // false for a NaN
    }
  } else if (!(damping > 0)) {
    const Triples triples = invert_by_triples(columns, size[0] / N, scale, rows);
    const Real lever2 = size[3] / size[0];
    if (triples.independent) {
      const Real unit = kSingular * lever2 * lever2 * lever2;
      return {triples.difference * triples.difference > unit, triples.determinant};
    }
  }
  const int sign = damping > 0 ? 0 : determinant_sign<N>(rows_of<N>(columns));
  return {invert_by_normal_equations<N>(columns, size, scale, damping, rows), Real(sign)};
}

/// A x of a matrix given by its rows.
template <int N>
inline Lanes<N> times(const Matrix<N, N>& rows, const Lanes<N>& x) {
  Lanes<N> result;
  for (int i = 0; i < N; ++i) result[i] = (Eigen::Map<const Lanes<N>>(rows[i].data()) * x).sum();
  return result;
}
}  // namespace truepose
