// Tails of the χ² distribution with an integer number of degrees of freedom.
#pragma once

#include "math/real.hpp"

namespace truepose {
/// P(χ² > x) with k degrees of freedom, by the recurrence in k (Abramowitz and Stegun, 26.4.8).
Real chi2_tail(Real x, int k);

/// The x that χ² with k degrees of freedom exceeds with a probability in (0, 1), by bisection.
Real chi2_beyond(Real probability, int k);
}  // namespace truepose
