// Rotations and rotation vectors: exp, log and the angle θ about z.
#pragma once

#include <numbers>

#include "truepose/math/lanes.hpp"

namespace truepose {
/// Rotation about z.
inline Mat3 rotation_z(Real angle) {
  const Real c = std::cos(angle), s = std::sin(angle);
  Mat3 R;
  R << c, -s, 0, s, c, 0, 0, 0, 1;
  return R;
}

/// sin(θ)/θ and (1 - cos θ)/θ² from θ². Up to 1 rad by series, which are exact to rounding, need no
/// root and cost a third of sine and cosine.
inline Pair versine_ratios(Real angle2) {
  if (!(angle2 < 1)) {
    const Real angle = std::sqrt(angle2);
    return {std::sin(angle) / angle, (1 - std::cos(angle)) / angle2};
  }
  // (-θ²)ᵏ/(2k+1)! and (-θ²)ᵏ/(2k+2)!, k = 0 … 8; even and odd powers apart to shorten the chain.
  const Real t = angle2, t2 = t * t, t4 = t2 * t2;
  const auto term = [](Real first, Real second) -> Pair { return {1 / first, 1 / second}; };
  const Pair low = (term(1, 2) - t * term(6, 24)) + t2 * (term(120, 720) - t * term(5040, 40320));
  const Pair high = (term(362880, 3628800) - t * term(39916800, 479001600)) +
                    t2 * (term(6227020800, 87178291200) - t * term(1307674368000, 20922789888000));
  return low + t4 * (high + t4 * term(355687428096000, 6402373705728000));
}

/// c I + [s]× + u wᵀ for u along w: a rotation by Rodrigues' formula.
inline Mat3 rodrigues(Real c, const Vec3& s, const Vec3& u, const Vec3& w) {
  const Real xy = u.x() * w.y(), xz = u.x() * w.z(), yz = u.y() * w.z();
  Mat3 R;
  R << c + u.x() * w.x(), xy - s.z(), xz + s.y(), xy + s.z(), c + u.y() * w.y(), yz - s.x(),
      xz - s.y(), yz + s.x(), c + u.z() * w.z();
  return R;
}

/// Rotation by the vector w: I + a W + b W², W² = w wᵀ - |w|² I.
inline Mat3 exp_so3(const Vec3& w) {
  const Real angle2 = w.squaredNorm();
  const Pair ratios = versine_ratios(angle2);
  return rodrigues(1 - ratios[1] * angle2, ratios[0] * w, ratios[1] * w, w);
}

/// exp(x d) about a unit vector, from cos x and sin x.
inline Mat3 turn_about(const Vec3& d, Real cosine, Real sine) {
  return rodrigues(cosine, sine * d, (1 - cosine) * d, d);
}

/// Rotation vector of R, angle in [0, π], through the quaternion: well conditioned everywhere.
inline Vec3 log_so3(const Mat3& R) {
  Eigen::Quaternion<Real> quaternion(R);
  if (quaternion.w() < 0) quaternion.coeffs() = -quaternion.coeffs();
  const Real s = quaternion.vec().norm();
  const Real c = quaternion.w();
  const Real half = c > 0.1 ? std::atan(s / c) : std::atan2(s, c);  // atan: half the cost
  return (s < 1e-10 ? 2.0 : 2.0 * half / s) * quaternion.vec();
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
    const Pair ratios = versine_ratios(w.squaredNorm());
    w.z() = -product * ratios[1] / ratios[0];
  }
  return w;
}
}  // namespace truepose
