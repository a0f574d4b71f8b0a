// How is a small square system solved? Newton's step, the columns of J, the sign of det J_x.
#pragma once

#include <algorithm>
#include <type_traits>

#include "truepose/ldlt.hpp"

namespace truepose {

/// Adjugate and determinant of a matrix of at most 4×4, by minors: products and sums only, no
/// branch and no division, so that it costs a third of a factorisation.
template <int N>
inline double adjugate(const std::array<std::array<double, N>, N>& a,
                       std::array<std::array<double, N>, N>& b) {
  static_assert(N >= 2 && N <= 4);
  if constexpr (N == 2) {
    b = {{{a[1][1], -a[0][1]}, {-a[1][0], a[0][0]}}};
    return a[0][0] * a[1][1] - a[0][1] * a[1][0];
  } else if constexpr (N == 3) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const auto &u = a[(j + 1) % 3], &v = a[(j + 2) % 3];
        b[i][j] = u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3];
      }
    return a[0][0] * b[0][0] + a[0][1] * b[1][0] + a[0][2] * b[2][0];
  } else {
    // 2×2 minors of the upper and of the lower two rows; Laplace's expansion puts them together.
    const auto minor = [&](int row, int i, int j) {
      return a[row][i] * a[row + 1][j] - a[row][j] * a[row + 1][i];
    };
    const double s01 = minor(0, 0, 1), s02 = minor(0, 0, 2), s03 = minor(0, 0, 3);
    const double s12 = minor(0, 1, 2), s13 = minor(0, 1, 3), s23 = minor(0, 2, 3);
    const double c01 = minor(2, 0, 1), c02 = minor(2, 0, 2), c03 = minor(2, 0, 3);
    const double c12 = minor(2, 1, 2), c13 = minor(2, 1, 3), c23 = minor(2, 2, 3);
    for (int j = 0; j < 4; ++j) {
      // Column j: row j^1 of a, the other row of its half, against the minors of the other half.
      const auto& r = a[j ^ 1];
      const double sign = j % 2 == 0 ? 1 : -1;
      const bool upper = j < 2;
      const double m01 = upper ? c01 : s01, m02 = upper ? c02 : s02, m03 = upper ? c03 : s03;
      const double m12 = upper ? c12 : s12, m13 = upper ? c13 : s13, m23 = upper ? c23 : s23;
      b[0][j] = sign * (r[1] * m23 - r[2] * m13 + r[3] * m12);
      b[1][j] = sign * (r[2] * m03 - r[0] * m23 - r[3] * m02);
      b[2][j] = sign * (r[0] * m13 - r[1] * m03 + r[3] * m01);
      b[3][j] = sign * (r[1] * m02 - r[0] * m12 - r[2] * m01);
    }
    return s01 * c23 - s02 * c13 + s03 * c12 + s12 * c03 - s13 * c02 + s23 * c01;
  }
}

/// Sign of the determinant, -1, 0 or 1: up to 4×4 by minors, above by elimination with partial
/// pivoting.
template <int N>
inline int determinant_sign(std::array<std::array<double, N>, N> m) {
  if constexpr (N <= 4) {
    std::array<std::array<double, N>, N> unused;
    const double determinant = adjugate<N>(m, unused);
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
      const double factor = m[i][k] / m[k][k];
      for (int j = k + 1; j < N; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  return sign;
}

/// Inverse of a square matrix of at most 4×4, by its adjugate.
template <int N>
class Inverse {
 public:
  using Vector = std::array<double, N>;
  using Matrix = std::array<Vector, N>;

  /// size[j] is what |column j|² would be if nothing in it cancelled: it gives the unit in which
  /// singularity is judged, so that neither metres nor radians matter.
  Inverse(const Matrix& a, const Vector& size) : determinant_(adjugate<N>(a, inverse_)) {
    double scale = kSingular;
    for (int j = 0; j < N; ++j) scale *= size[j];
    regular_ = determinant_ * determinant_ > scale;  // false for a NaN
    const double per_determinant = 1 / determinant_;
    for (int i = 0; i < N; ++i)
      for (int j = 0; j < N; ++j) inverse_[i][j] *= per_determinant;
  }
  bool regular() const { return regular_; }

  Vector solve(const Vector& b) const {
    Vector x{};
    for (int i = 0; i < N; ++i)
      for (int j = 0; j < N; ++j) x[i] += inverse_[i][j] * b[j];
    return x;
  }

  /// Column j of A⁻¹, times scale.
  Vector column(int j, double scale) const {
    Vector x;
    for (int i = 0; i < N; ++i) x[i] = scale * inverse_[i][j];
    return x;
  }

 private:
  Matrix inverse_;
  double determinant_;
  bool regular_;
};

/// Solves (AᵀA + damping · diag(size)) x = Aᵀ b: any size, and Levenberg's damped steps.
template <int N>
class NormalEquations {
 public:
  using Vector = std::array<double, N>;
  using Matrix = std::array<Vector, N>;

  NormalEquations(const Matrix& a, const Vector& size, double damping = 0)
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
  Vector column(int j, double scale) const {
    Vector x;
    for (int i = 0; i < N; ++i) x[i] = scale * a_[j][i];
    factor_.solve(x);
    return x;
  }

 private:
  static Matrix normal(const Matrix& a, const Vector& size, double damping) {
    Matrix result;
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j <= i; ++j) {
        double sum = 0;
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

/// What solves an undamped N×N system at the least cost.
template <int N>
using Square = std::conditional_t<(N <= 4), Inverse<N>, NormalEquations<N>>;

}  // namespace truepose
