// Rotations and rotation vectors: exp, log and the angle θ about z.
#pragma once

#include <array>

#include "math/vec3.hpp"

namespace truepose {
/// Rotation about z.
inline Mat3 rotation_z(Real angle) {
  const Real c = cos(angle), s = sin(angle);
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
Versine versine_ratios(Real angle2);

/// c I + [s]× + u wᵀ for u along w: a rotation by Rodrigues' formula.
Mat3 rodrigues(Real c, const Vec3& s, const Vec3& u, const Vec3& w);

/// Rotation by the vector w: I + a W + b W², W² = w wᵀ - |w|² I.
Mat3 exp_so3(const Vec3& w);

/// exp(x d) about a unit vector, from cos x and sin x.
inline Mat3 turn_about(const Vec3& d, Real cosine, Real sine) {
  return rodrigues(cosine, sine * d, (1 - cosine) * d, d);
}

/// Rotation vector of R, angle in [0, π], through the quaternion: well conditioned everywhere.
Vec3 log_so3(const Mat3& R);

/// θ of R next to `near`, turns included. Beyond 1000 rad turns are dropped: they would cost θ its
/// last digits (1e-13 rad).
Real theta_of(const Mat3& R, Real near);

inline constexpr int kTiltIterations = 4;

/// The rotation vector w with the given x and y that keeps θ = atan2(R_10, R_00) of exp(w) R_z(θ).
///
/// R_z(θ) e_x = e is level, n = e_z × e is normal to it, and θ is unchanged where n · exp(w) e = 0.
/// By Rodrigues' formula w_z sin φ/φ + (n·w)(e·w)(1 - cos φ)/φ² = 0, φ = |w|. w_z is of second
/// order in the tilt and enters φ² squared: each iteration leaves a fraction of fourth order.
Vec3 tilt_keeping(Real theta, Real about_x, Real about_y);
}  // namespace truepose
