// Vectors and matrices of space, as plain numbers that are copied byte by byte.
#pragma once

#include <cstddef>

#include "math/real.hpp"

namespace truepose {
/// Three numbers; not initialised by default.
struct Vec3 {
  Real number[3];

  Vec3() = default;
  constexpr Vec3(Real x, Real y, Real z) : number{x, y, z} {}
  static constexpr Vec3 Zero() { return {0, 0, 0}; }
  static constexpr Vec3 UnitX() { return {1, 0, 0}; }
  static constexpr Vec3 UnitY() { return {0, 1, 0}; }
  static constexpr Vec3 UnitZ() { return {0, 0, 1}; }
  static constexpr Vec3 Unit(int i) { return {Real(i == 0), Real(i == 1), Real(i == 2)}; }

  constexpr Real x() const { return number[0]; }
  constexpr Real y() const { return number[1]; }
  constexpr Real z() const { return number[2]; }
  constexpr Real& x() { return number[0]; }
  constexpr Real& y() { return number[1]; }
  constexpr Real& z() { return number[2]; }
  constexpr Real operator[](int i) const { return number[i]; }
  constexpr Real& operator[](int i) { return number[i]; }
  const Real* data() const { return number; }
  Real* data() { return number; }

  constexpr Vec3& operator+=(const Vec3& b) {
    return *this = {x() + b.x(), y() + b.y(), z() + b.z()};
  }
  constexpr Vec3& operator-=(const Vec3& b) {
    return *this = {x() - b.x(), y() - b.y(), z() - b.z()};
  }
  constexpr Vec3& operator*=(Real s) { return *this = {s * x(), s * y(), s * z()}; }
  constexpr Real dot(const Vec3& b) const { return x() * b.x() + y() * b.y() + z() * b.z(); }
  constexpr Vec3 cross(const Vec3& b) const {
    return {y() * b.z() - z() * b.y(), z() * b.x() - x() * b.z(), x() * b.y() - y() * b.x()};
  }
  constexpr Real squaredNorm() const { return dot(*this); }
  Real norm() const { return sqrt(squaredNorm()); }
  constexpr Real sum() const { return x() + y() + z(); }
  bool allFinite() const { return isfinite(x()) && isfinite(y()) && isfinite(z()); }
  Vec3 normalized() const;
};
constexpr Vec3 operator+(Vec3 a, const Vec3& b) { return a += b; }
constexpr Vec3 operator-(Vec3 a, const Vec3& b) { return a -= b; }
constexpr Vec3 operator-(const Vec3& a) { return {-a.x(), -a.y(), -a.z()}; }
constexpr Vec3 operator*(Real s, Vec3 a) { return a *= s; }
constexpr Vec3 operator*(Vec3 a, Real s) { return a *= s; }
constexpr Vec3 operator/(const Vec3& a, Real s) { return {a.x() / s, a.y() / s, a.z() / s}; }
inline Vec3 Vec3::normalized() const { return *this / norm(); }
/// A unit vector normal to a.
inline Vec3 normal_to(const Vec3& a) {
  return a.cross(fabs(a.x()) < 0.6 * a.norm() ? Vec3::UnitX() : Vec3::UnitY()).normalized();
}

/// Nine numbers, by columns; not initialised by default.
struct Mat3 {
  Vec3 column[3];

  /// By rows.
  static constexpr Mat3 of(Real xx, Real xy, Real xz, Real yx, Real yy, Real yz, Real zx, Real zy,
                           Real zz) {
    return {{{xx, yx, zx}, {xy, yy, zy}, {xz, yz, zz}}};
  }
  static constexpr Mat3 Zero() { return of(0, 0, 0, 0, 0, 0, 0, 0, 0); }
  static constexpr Mat3 Identity() { return of(1, 0, 0, 0, 1, 0, 0, 0, 1); }

  constexpr Real operator()(int i, int j) const { return column[j][i]; }
  constexpr Real& operator()(int i, int j) { return column[j][i]; }
  constexpr const Vec3& col(int j) const { return column[j]; }
  constexpr Vec3& col(int j) { return column[j]; }
  const Real* data() const { return column[0].number; }
  Real* data() { return column[0].number; }
  constexpr Mat3 transpose() const {
    const auto& m = *this;
    return of(m(0, 0), m(1, 0), m(2, 0), m(0, 1), m(1, 1), m(2, 1), m(0, 2), m(1, 2), m(2, 2));
  }
  constexpr Real trace() const { return column[0].x() + column[1].y() + column[2].z(); }
  bool allFinite() const {
    return column[0].allFinite() && column[1].allFinite() && column[2].allFinite();
  }
  /// Frobenius'.
  Real norm() const {
    return sqrt(column[0].squaredNorm() + column[1].squaredNorm() + column[2].squaredNorm());
  }
  constexpr Mat3& operator+=(const Mat3& b) {
    for (int j : range(3)) column[j] += b.column[j];
    return *this;
  }
};
constexpr Vec3 operator*(const Mat3& A, const Vec3& b) {
  return b.x() * A.col(0) + b.y() * A.col(1) + b.z() * A.col(2);
}

constexpr Mat3 operator*(const Mat3& A, const Mat3& B) {
  return {{A * B.col(0), A * B.col(1), A * B.col(2)}};
}

constexpr Mat3 operator*(Real s, const Mat3& A) {
  return {{s * A.col(0), s * A.col(1), s * A.col(2)}};
}

constexpr Mat3 operator+(Mat3 A, const Mat3& B) { return A += B; }
constexpr Mat3 operator-(const Mat3& A, const Mat3& B) { return A + -1 * B; }
/// a bᵀ
constexpr Mat3 outer(const Vec3& a, const Vec3& b) { return {{b.x() * a, b.y() * a, b.z() * a}}; }
}  // namespace truepose
