// Reading of a rotary encoder with an eccentric disc.
#include "mechanism/encoder.hpp"

namespace truepose {
Encoded encode(const Eccentricity& encoder, Real angle) {
  const std::array<Real, 4> h = harmonics(encoder, angle), &a = encoder.amplitude;
  return {angle + (a[0] * h[0] + a[1] * h[1] + a[2] * h[2] + a[3] * h[3]) / encoder.gear,
          1 - a[0] * h[1] + a[1] * h[0] - 2 * (a[2] * h[3] - a[3] * h[2])};
}

Real decode(const Eccentricity& encoder, Real value) {
  Real angle = value;
  for (int k = 0; k < kDecodeIterations; ++k) {
    const Encoded read = encode(encoder, angle);
    const Real step = (value - read.value) / read.slope;
    angle += step;
    if (!(fabs(step) > by_precision(1e-12, 1e-6)))
      break;  // quadratic: the next one is below rounding
  }
  return angle;
}
}  // namespace truepose
