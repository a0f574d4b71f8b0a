#include "control/reading_noise.hpp"

namespace truepose {
Real noisiest(Real period, Real acceleration, Real left) {
  Real sigma = left;
  for (int pass = 0; pass < 30; ++pass)
    sigma = left / std::sqrt(Real{1.25} * period * std::sqrt(acceleration / sigma));
  return sigma;
}
}  // namespace truepose
