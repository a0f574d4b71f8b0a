// Reading of a rotary encoder with an eccentric disc.
#pragma once

#include <array>

#include "math/real.hpp"

namespace truepose {
/// First and second harmonic of an encoder's error. At φ = gear · angle the shaft reads φ + e(φ),
/// e(φ) = c1 cos φ + s1 sin φ + c2 cos 2φ + s2 sin 2φ; the angle reads angle + e(φ)/gear.
struct Eccentricity {
  Real gear = 1;                    ///< turns of the shaft per turn of the measured joint
  std::array<Real, 4> amplitude{};  ///< c1, s1, c2, s2, rad of the shaft

  bool any() const {
    return amplitude[0] != 0 || amplitude[1] != 0 || amplitude[2] != 0 || amplitude[3] != 0;
  }
};

/// cos φ, sin φ, cos 2φ, sin 2φ: e's derivatives with respect to its amplitudes.
inline std::array<Real, 4> harmonics(const Eccentricity& encoder, Real angle) {
  const Real phi = encoder.gear * angle;
  return {cos(phi), sin(phi), cos(2 * phi), sin(2 * phi)};
}

/// Reading of an angle, and the derivative 1 + e'(φ).
struct Encoded {
  Real value, slope;
};
Encoded encode(const Eccentricity& encoder, Real angle);

inline constexpr int kDecodeIterations = 12;

/// Angle of a reading, by Newton's method. Unique where 1 + e' > 0, as for every usable encoder.
Real decode(const Eccentricity& encoder, Real value);
}  // namespace truepose
