// Solution of a small system, square or in least squares: Newton's step, the columns of J, the sign
// of det J_x.
#include "math/square.hpp"

#include "math/vec3.hpp"

namespace truepose {
namespace {
constexpr int sign_of(Real value) { return (value > 0) - (value < 0); }

/// f(n), with the loops unrolled for six rods: at a half of the cost.
template <class F>
void with_size(int n, F&& f) {
  n == 6 ? f(std::integral_constant<int, 6>{}) : f(n);
}
}  // namespace

Factors::Factors(int rows, int n, const Unknowns* a, const Unknowns& size, Real damping)
    : rows_(rows), n_(n), a_(a), square_(rows == n && !(damping > 0)), small_(square_ && n <= 4) {
  if (small_) {
    adjugate(size);
    return;
  }
  for (int i : range(n)) {
    order_[i] = i;
    for (int j : range(n))
      lu_[i][j] = square_ ? a[i][j] : sum_of(rows, [&](int k) { return a[k][i] * a[k][j]; });
    if (!square_) lu_[i][i] += damping * size[i];
  }
  factorise(size);
}

void Factors::adjugate(const Unknowns& size) {
  const auto entry = [&](int i, int j) { return i < n_ && j < n_ ? a_[i][j] : Real(i == j); };
  const auto column = [&](int j) { return Vec3(entry(0, j), entry(1, j), entry(2, j)); };
  const Vec3 a = column(0), b = column(1), c = column(2), d = column(3);
  const Real x = entry(3, 0), y = entry(3, 1), z = entry(3, 2), w = entry(3, 3);
  const Vec3 s = a.cross(b), t = c.cross(d), u = y * a - x * b, v = w * c - z * d;
  const Vec3 first[]{b.cross(v) + y * t, v.cross(a) - x * t, d.cross(u) + w * s,
                     u.cross(c) - z * s};
  const Real last[]{-b.dot(t), a.dot(t), -d.dot(s), c.dot(s)};
  const Real determinant = s.dot(v) + t.dot(u), per_determinant = 1 / determinant;
  Real unit = kSingular;
  for (int i : range(n_)) {
    unit *= size[i];
    for (int j : range(n_)) lu_[i][j] = per_determinant * (j < 3 ? first[i][j] : last[i]);
  }
  regular_ = determinant * determinant > unit;  // false for a NaN
  sign_ = sign_of(determinant);
}

void Factors::factorise(const Unknowns& size) {
  sign_ = square_;
  with_size(n_, [&](auto n) {
    for (int k : range(n)) {
      int best = k;
      for (int i = k + 1; i < n && square_; ++i)
        if (fabs(lu_[i][k]) > fabs(lu_[best][k])) best = i;
      if (best != k) {
        sign_ = -sign_;
        std::swap(order_[k], order_[best]);
        std::swap(lu_[k], lu_[best]);
      }
      const Real pivot = lu_[k][k];
      // Against its column's size; false for a NaN.
      regular_ = regular_ && (square_ ? pivot * pivot : pivot) > kSingular * size[k];
      sign_ *= sign_of(pivot);
      inverse_[k] = 1 / pivot;
      for (int i : range(k + 1, n)) {
        const Real factor = lu_[i][k] *= inverse_[k];
        for (int j : range(k + 1, n)) lu_[i][j] -= factor * lu_[k][j];
      }
    }
  });
}

Unknowns Factors::solve(const Real* b) const {
  Unknowns x;
  if (small_) {
    for (int i : range(n_)) x[i] = sum_of(n_, [&](int j) { return lu_[i][j] * b[j]; });
    return x;
  }
  for (int i : range(n_))
    x[i] = square_ ? b[order_[i]] : sum_of(rows_, [&](int k) { return a_[k][i] * b[k]; });
  with_size(n_, [&](auto n) {
    for (int i : range(1, n))
      for (int k : range(i)) x[i] -= lu_[i][k] * x[k];
    for (int i = n - 1; i >= 0; --i) {
      for (int k : range(i + 1, n)) x[i] -= lu_[i][k] * x[k];
      x[i] *= inverse_[i];
    }
  });
  return x;
}

Unknowns Factors::column(int j) const {
  std::array<Real, kMaxRods> unit{};
  unit[j] = 1;
  return solve(unit.data());
}

void Factors::invert(Square& inverse) const {
  for (int j : range(rows_)) {
    if (small_) {
      copy_first(n_, lu_[j], inverse[j]);
      continue;
    }
    const Unknowns by = column(j);
    for (int i : range(n_)) inverse[i][j] = by[i];
  }
}

Inverted invert(int rows, int n, const Square& a, const Unknowns& size, Square& inverse) {
  const Factors factors(rows, n, a.data(), size);
  factors.invert(inverse);
  if (rows == n) return {factors.regular(), factors.sign()};
  // A⁺ ← (2 - A⁺A) A⁺: AᵀA has the square of A's condition number, this error has not.
  const Square first = inverse;
  for (int i : range(n)) {
    Unknowns left;
    for (int l : range(n))
      left[l] = (i == l ? 2 : 0) - sum_of(rows, [&](int k) { return first[i][k] * a[k][l]; });
    for (int j : range(rows))
      inverse[i][j] = sum_of(n, [&](int l) { return left[l] * first[l][j]; });
  }
  return {factors.regular(), 0};
}
}  // namespace truepose
