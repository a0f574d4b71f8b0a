// Rotations and rotation vectors: exp, log and the angle θ about z.
#pragma once

#include <array>
#include <numbers>

#include "truepose/math/vec3.hpp"

namespace truepose {
/// Rotation about z.
inline Mat3 rotation_z(Real angle) {
  const Real c = std::cos(angle), s = std::sin(angle);
  return Mat3::of(c, -s, 0, s, c, 0, 0, 0, 1);
}

/// sin(θ)/θ and (1 - cos θ)/θ² of a rotation.
struct Versine {
  Real sine, versine;
};

/// 1/(2k (2k+1)) and 1/((2k+1) (2k+2)).
inline constexpr std::array<Real, 9> kPerOdd{0,         1.0 / 6,   1.0 / 20,  1.0 / 42, 1.0 / 72,
                                             1.0 / 110, 1.0 / 156, 1.0 / 210, 1.0 / 272};
inline constexpr std::array<Real, 9> kPerEven{0,         1.0 / 12,  1.0 / 30,  1.0 / 56, 1.0 / 90,
                                              1.0 / 132, 1.0 / 182, 1.0 / 240, 1.0 / 306};
/// Of θ². Up to 1 rad by series, which are exact to rounding, need no root and cost a third of sine
/// and cosine: (-θ²)ᵏ/(2k+1)! and (-θ²)ᵏ/(2k+2)!, k = 0 … 8.
inline Versine versine_ratios(Real angle2) {
  if (!(angle2 < 1)) {
    const Real angle = std::sqrt(angle2);
    return {std::sin(angle) / angle, (1 - std::cos(angle)) / angle2};
  }
  Real sine = 1, versine = 1;
  for (int k = 8; k > 0; --k) {  // Horner's scheme
    sine = 1 - sine * (angle2 * kPerOdd[k]);
    versine = 1 - versine * (angle2 * kPerEven[k]);
  }
  return {sine, 0.5 * versine};
}

/// c I + [s]× + u wᵀ for u along w: a rotation by Rodrigues' formula.
inline Mat3 rodrigues(Real c, const Vec3& s, const Vec3& u, const Vec3& w) {
  const Real xy = u.x() * w.y(), xz = u.x() * w.z(), yz = u.y() * w.z();
  return Mat3::of(c + u.x() * w.x(), xy - s.z(), xz + s.y(), xy + s.z(), c + u.y() * w.y(),
                  yz - s.x(), xz - s.y(), yz + s.x(), c + u.z() * w.z());
}

/// Rotation by the vector w: I + a W + b W², W² = w wᵀ - |w|² I.
inline Mat3 exp_so3(const Vec3& w) {
  const Real angle2 = w.squaredNorm();
  const Versine ratios = versine_ratios(angle2);
  return rodrigues(1 - ratios.versine * angle2, ratios.sine * w, ratios.versine * w, w);
}

/// exp(x d) about a unit vector, from cos x and sin x.
inline Mat3 turn_about(const Vec3& d, Real cosine, Real sine) {
  return rodrigues(cosine, sine * d, (1 - cosine) * d, d);
}

/// Rotation vector of R, angle in [0, π], through the quaternion: well conditioned everywhere.
inline Vec3 log_so3(const Mat3& R) {
  Real c;  // cos(angle/2)
  Vec3 v;  // sin(angle/2) along the axis
  if (const Real trace = R.trace(); trace > 0) {
    const Real t = std::sqrt(trace + 1);
    c = 0.5 * t;
    v = 0.5 / t * Vec3(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  } else {
    int i = R(1, 1) > R(0, 0) ? 1 : 0;
    if (R(2, 2) > R(i, i)) i = 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const Real t = std::sqrt(R(i, i) - R(j, j) - R(k, k) + 1), per = 0.5 / t;
    v[i] = 0.5 * t;
    v[j] = per * (R(j, i) + R(i, j));
    v[k] = per * (R(k, i) + R(i, k));
    c = per * (R(k, j) - R(j, k));
  }
  if (c < 0) {
    c = -c;
    v = -v;
  }
  const Real s = v.norm();
  const Real half = c > 0.1 ? std::atan(s / c) : std::atan2(s, c);  // atan: half the cost
  return (s < 1e-10 ? 2.0 : 2.0 * half / s) * v;
}

/// θ of R next to `near`, turns included. Beyond 1000 rad turns are dropped: they would cost θ its
/// last digits (1e-13 rad).
inline Real theta_of(const Mat3& R, Real near) {
  const Real theta = std::atan2(R(1, 0), R(0, 0));
  if (!(std::fabs(near) < 1000)) return theta;
  return theta + 2 * std::numbers::pi_v<Real> *
                     std::nearbyint((near - theta) / (2 * std::numbers::pi_v<Real>));
}

/// R turned about z to the given θ: undoes the second-order change of θ by a small turn.
inline Mat3 with_theta(const Mat3& R, Real theta) {
  return rotation_z(theta - std::atan2(R(1, 0), R(0, 0))) * R;
}

inline constexpr int kTiltIterations = 4;

/// The rotation vector w with the given x and y that keeps θ = atan2(R_10, R_00) of exp(w) R_z(θ).
///
/// R_z(θ) e_x = e is level, n = e_z × e is normal to it, and θ is unchanged where n · exp(w) e = 0.
/// By Rodrigues' formula w_z sin φ/φ + (n·w)(e·w)(1 - cos φ)/φ² = 0, φ = |w|. w_z is of second
/// order in the tilt and enters φ² squared: each iteration leaves a fraction of fourth order.
inline Vec3 tilt_keeping(Real theta, Real about_x, Real about_y) {
  const Real c = std::cos(theta), s = std::sin(theta);
  const Real product = (c * about_x + s * about_y) * (c * about_y - s * about_x);
  Vec3 w(about_x, about_y, 0);
  for (int k = 0; k < kTiltIterations; ++k) {
    const Versine ratios = versine_ratios(w.squaredNorm());
    w.z() = -product * ratios.versine / ratios.sine;
  }
  return w;
}
}  // namespace truepose
