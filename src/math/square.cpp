#include "math/square.hpp"

namespace truepose::square_detail {
Inverted by_elimination(int n, const Square& a, const Unknowns& size, Square& inverse) {
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

}  // namespace truepose::square_detail

namespace truepose {
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
    case 1: return square_detail::by_adjugate<1>(a, size, inverse);
    case 2: return square_detail::by_adjugate<2>(a, size, inverse);
    case 3: return square_detail::by_adjugate<3>(a, size, inverse);
    case 4: return square_detail::by_adjugate<4>(a, size, inverse);
    default: return square_detail::by_elimination(n, a, size, inverse);
  }
}

int determinant_sign(int n, Square m) {
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
