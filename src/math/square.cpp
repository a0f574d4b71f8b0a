#include "math/square.hpp"

namespace truepose {
namespace {
/// Up to 4×4, without branches.
template <int N>
Inverted by_adjugate(const Square& a, const Unknowns& size, Square& inverse) {
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

/// Gauss-Jordan elimination in place, pivots by rows, which stay where they are: row p[k] is the
/// k-th. @tparam N  the size where the compiler knows it, at a half of the cost; 0: n
template <int N>
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
    for (int i = 0; i < n; ++i) {
      if (i == p[k]) continue;
      const Real factor = m[i][k];
      m[i][k] = 0;
#pragma GCC unroll 6
      for (int j = 0; j < n; ++j) m[i][j] -= factor * pivots[j];
    }
  }
  for (int i = 0; i < n; ++i)
#pragma GCC unroll 6
    for (int j = 0; j < n; ++j) inverse[i][p[j]] = m[p[i]][j];
  return result;
}
}  // namespace

Inverted invert(int n, const Square& a, const Unknowns& size, Real damping, Square& inverse) {
  if (damping > 0) {
    const NormalEquations normal(n, a, size, damping);
    for (int j = 0; j < n; ++j) {
      const Unknowns column = normal.column(j, 1);
      for (int i = 0; i < n; ++i) inverse[i][j] = column[i];
    }
    return {normal.regular(), 0};
  }
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
  return invert(n, a, {}, 0, inverse).sign;
}
}  // namespace truepose
