// Solution of a small square system: Newton's step, the columns of J, the sign of det J_x.
#include "math/square.hpp"

#include "math/vec3.hpp"

namespace truepose {
namespace {
/// Adjugate of a matrix up to 4×4 by minors; returns the determinant. Without branches and
/// divisions, at a third of the cost of a factorisation.
template <int N>
Real adjugate(const Square& a, Square& b) {
  static_assert(N >= 1 && N <= 4);
  if constexpr (N == 1) {
    b[0][0] = 1;
    return a[0][0];
  } else if constexpr (N == 2) {
    b[0][0] = a[1][1];
    b[0][1] = -a[0][1];
    b[1][0] = -a[1][0];
    b[1][1] = a[0][0];
    return a[0][0] * a[1][1] - a[0][1] * a[1][0];
  } else if constexpr (N == 3) {
    const auto row = [&](int i) { return Vec3(a[i][0], a[i][1], a[i][2]); };
    const Vec3 x = row(0), y = row(1), z = row(2), column[]{y.cross(z), z.cross(x), x.cross(y)};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) b[i][j] = column[j][i];
    return x.dot(column[0]);
  } else {
    // 2×2 minors of the upper and of the lower two rows, combined by Laplace's expansion.
    const auto minor = [&](int row, int i, int j) {
      return a[row][i] * a[row + 1][j] - a[row][j] * a[row + 1][i];
    };
    const Real s01 = minor(0, 0, 1), s02 = minor(0, 0, 2), s03 = minor(0, 0, 3);
    const Real s12 = minor(0, 1, 2), s13 = minor(0, 1, 3), s23 = minor(0, 2, 3);
    const Real c01 = minor(2, 0, 1), c02 = minor(2, 0, 2), c03 = minor(2, 0, 3);
    const Real c12 = minor(2, 1, 2), c13 = minor(2, 1, 3), c23 = minor(2, 2, 3);
    for (int j = 0; j < 4; ++j) {
      // Column j: row j^1 of a, the other row of its half, times the minors of the other half.
      const auto& r = a[j ^ 1];
      const Real sign = j % 2 == 0 ? 1 : -1;
      const bool upper = j < 2;
      const Real m01 = upper ? c01 : s01, m02 = upper ? c02 : s02, m03 = upper ? c03 : s03;
      const Real m12 = upper ? c12 : s12, m13 = upper ? c13 : s13, m23 = upper ? c23 : s23;
      b[0][j] = sign * (r[1] * m23 - r[2] * m13 + r[3] * m12);
      b[1][j] = sign * (r[2] * m03 - r[0] * m23 - r[3] * m02);
      b[2][j] = sign * (r[0] * m13 - r[1] * m03 + r[3] * m01);
      b[3][j] = sign * (r[1] * m02 - r[0] * m12 - r[2] * m01);
    }
    return s01 * c23 - s02 * c13 + s03 * c12 + s12 * c03 - s13 * c02 + s23 * c01;
  }
}

/// Up to 4×4.
template <int N>
Inverted by_adjugate(const Square& a, const Unknowns& size, Square& inverse) {
  const Real determinant = adjugate<N>(a, inverse), per_determinant = 1 / determinant;
  Real unit = kSingular;
  for (int i = 0; i < N; ++i) {
    unit *= size[i];
    for (int j = 0; j < N; ++j) inverse[i][j] *= per_determinant;
  }
  // false for a NaN
  return {determinant * determinant > unit, (determinant > 0) - (determinant < 0)};
}

/// Gauss-Jordan elimination in place, pivots by rows, which stay where they are: row p[k] is the
/// k-th. @tparam N  the size where the compiler knows it, at a half of the cost; 0: n
/// @tparam Whole  false: only down to a triangle, for the determinant
template <int N, bool Whole = true>
Inverted by_elimination(int size_of, const Square& a, const Unknowns& size, Square& inverse) {
  const int n = N > 0 ? N : size_of;
  constexpr int width = N > 0 ? N : kMaxUnknowns;
  Real m[width][width], pivots[width];
  std::array<int, width> p;
  for (int i = 0; i < n; ++i) {
    p[i] = i;
    for (int j = 0; j < n; ++j) m[i][j] = a[i][j];
  }
  Inverted result{true, 1};
  for (int k = 0; k < n; ++k) {
    int best = k;
    for (int i = k + 1; i < n; ++i)
      if (std::fabs(m[p[i]][k]) > std::fabs(m[p[best]][k])) best = i;
    if (best != k) result.sign = -result.sign;
    std::swap(p[k], p[best]);
    Real* row = m[p[k]];
    const Real pivot = row[k], per_pivot = 1 / pivot;
    // Against its column's size; false for a NaN.
    result.regular = result.regular && pivot * pivot > kSingular * size[k];
    result.sign = pivot > 0 ? result.sign : pivot < 0 ? -result.sign : 0;
    row[k] = 1;
    for (int j = 0; j < n; ++j) pivots[j] = row[j] *= per_pivot;
    for (int t = Whole ? 0 : k + 1; t < n; ++t) {
      if (t == k) continue;
      Real* other = m[p[t]];
      const Real factor = other[k];
      other[k] = 0;
#pragma GCC unroll 6
      for (int j = 0; j < n; ++j) other[j] -= factor * pivots[j];
    }
  }
  for (int i = 0; i < n && Whole; ++i)
#pragma GCC unroll 6
    for (int j = 0; j < n; ++j) inverse[i][p[j]] = m[p[i]][j];
  return result;
}

/// By the normal equations; kept apart, whose stack is twice that of a square matrix.
[[gnu::noinline]] Inverted by_least_squares(int rows, int n, const Square& a, const Unknowns& size,
                                            Real damping, Square& inverse) {
  const NormalEquations normal(rows, n, a, size, damping);
  for (int j = 0; j < rows; ++j) {
    const Unknowns column = normal.column(j, 1);
    for (int i = 0; i < n; ++i) inverse[i][j] = column[i];
  }
  if (damping > 0) return {normal.regular(), 0};
  // A⁺ ← (2 - A⁺A) A⁺: AᵀA has the square of A's condition number, this error has not.
  const Square first = inverse;
  for (int i = 0; i < n; ++i) {
    std::array<Real, kMaxUnknowns> left;
    for (int l = 0; l < n; ++l)
      left[l] = (i == l ? 2 : 0) - sum_of(rows, [&](int k) { return first[i][k] * a[k][l]; });
    for (int j = 0; j < rows; ++j)
      inverse[i][j] = sum_of(n, [&](int l) { return left[l] * first[l][j]; });
  }
  return {normal.regular(), 0};
}
}  // namespace

Inverted invert(int rows, int n, const Square& a, const Unknowns& size, Real damping,
                Square& inverse) {
  if (damping > 0 || rows > n) return by_least_squares(rows, n, a, size, damping, inverse);
  switch (n) {
    case 1: return by_adjugate<1>(a, size, inverse);
    case 2: return by_adjugate<2>(a, size, inverse);
    case 3: return by_adjugate<3>(a, size, inverse);
    case 4: return by_adjugate<4>(a, size, inverse);
    case 6: return by_elimination<6>(n, a, size, inverse);
    default: return by_elimination<0>(n, a, size, inverse);
  }
}

int determinant_sign(int n, const Square& a) {
  Square inverse;
  if (n <= 4) return invert(n, n, a, {}, 0, inverse).sign;
  if (n == 6) return by_elimination<6, false>(n, a, {}, inverse).sign;
  return by_elimination<0, false>(n, a, {}, inverse).sign;
}
}  // namespace truepose
