// Tails of the χ² distribution with an integer number of degrees of freedom.
#include "math/chi2.hpp"

namespace truepose {
Real chi2_tail(Real x, int k) {
  const Real half = 0.5 * x;
  Real tail = k % 2 ? std::erfc(sqrt(half)) : 0;
  Real term = k % 2 ? exp(-half) * sqrt(half) * 2 * std::numbers::inv_sqrtpi_v<Real> : exp(-half);
  for (int m = k % 2 ? 3 : 2; m <= k; m += 2) {  // term: (x/2)^(m/2-1) e^(-x/2) / Γ(m/2)
    tail += term;
    term *= half / (0.5 * m);
  }
  return tail;
}

Real chi2_beyond(Real probability, int k) {
  if (k < 1) return 0;
  Real low = 0, high = 1;
  while (chi2_tail(high, k) > probability && high < 1e4) high *= 2;
  for (int step = 0; step < 60; ++step) {
    const Real middle = 0.5 * (low + high);
    (chi2_tail(middle, k) > probability ? low : high) = middle;
  }
  return high;
}
}  // namespace truepose
