// Covariances of the geometry and of the readings: Σ_ξ and Σ_s.
#pragma once

#include <cstdint>

#include "mechanism/parameters.hpp"

namespace truepose {
/// Normal distributions of the uncertain parameters and of the readings' errors. The arrays are the
/// caller's: a prior or the posterior of a calibration.
struct Knowledge {
  int count = 0;  ///< p, uncertain parameters
  /// Each one's column of H_ξ (parameters.hpp); -1: no reading depends on it through H_ξ.
  const std::int32_t* column = nullptr;
  const Real* root = nullptr;  ///< S, p×p by rows, lower triangular: Σ_ξ = S Sᵀ; nullptr: S = I
  Extended sigma{};            ///< σ of every reading's own error, > 0: Σ_s = diag(σ²)
};

/// Number of parameters before the first one without a column of H_ξ.
inline int gathered(const Knowledge& known) {
  return int(std::find(known.column, known.column + known.count, -1) - known.column);
}

/// Gathers the first `count` uncertain columns of row c of H_ξ, divided by its reading's σ.
inline void gather_row(const Robot& robot, const Knowledge& known, int count, const Real* H_xi,
                       int c, Real* row) {
  const Real per_sigma = 1 / known.sigma[c];
  H_xi += c * parameter_count(robot);
  for (int k : range(count)) row[k] = per_sigma * H_xi[known.column[k]];
}

/// Gathers the columns of `rows` rows. Entries from the first parameter without one on are left
/// unchanged.
inline void gather(const Robot& robot, const Knowledge& known, const Real* H_xi, int rows,
                   Real* B) {
  const int count = gathered(known);
  for (int c : range(rows)) gather_row(robot, known, count, H_xi, c, B + c * known.count);
}

/// B S in place, in blocks: entry j of a row depends on those from j on. Only the nonzero span of a
/// row is multiplied: at first a motor's row has only its own chain's parameters.
void times_root(const Knowledge& known, int rows, Real* B);
}  // namespace truepose
