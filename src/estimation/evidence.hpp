// Evidence for hypotheses: columns of unknown amounts in whitened equations.
//
// Equations y = C a + ε, ε ~ N(0, I). Allowing for one amount without a prior lowers χ² by
// (cᵀy)²/cᵀc (the generalised likelihood ratio). Amounts a ~ N(0, I) have, over none, the log
// marginal likelihood zᵀ(I + S)⁻¹z / 2 - log det(I + S) / 2 with z = Cᵀy and S = CᵀC.
#pragma once

#include "math/ldlt.hpp"
#include "mechanism/pose.hpp"

namespace truepose {
/// One column over equations.
struct Column {
  Real score = 0, information = 0;  ///< cᵀy, cᵀc

  void add(Real c, Real y, Real variance = 1) {
    score += c * y / variance;
    information += c * c / variance;
  }
  /// Decrease of χ².
  Real chi2() const { return information > kSingular ? score * score / information : 0; }
  /// Log odds, over none, of an amount ~ N(0, variance).
  Real log_odds(Real variance) const {
    const Real volume = 1 + variance * information;
    return (variance * score * score / volume - log(volume)) / 2;
  }
};

/// Evidence of several columns together, over none.
struct Evidence {
  Real log_odds = 0, chi2 = 0;  ///< log of the marginal likelihood; decrease of χ²
};
/// @param S  n × n, lower triangle; overwritten @param z  overwritten
Evidence evidence(int n, Real* S, Real* z);

inline constexpr Real kGate = 4;  ///< σ: excludes 6 of 1e5 clean rows

/// χ² of `count` degrees of freedom as unlikely as a normal variable beyond `gate` σ: its root is
/// within t of √count like a single one's within t of 1 (concentration of measure).
inline Real beyond(Real gate, int count) {
  const Real root = gate - 1 + sqrt(Real(count));
  return root * root;
}

/// Index of the entry that exceeds all others by more than `margin`, or -1.
int outstanding(int count, const Extended& value, Real margin);
}  // namespace truepose
