// Marginal likelihood of a log's rows under hypotheses: each one more column, beside the ordinary.
//
// Rows y = B u + s (D η + ε) + C a: u ~ N(0, t² I) the parameters in units of their σ, ε ~ N(0, I)
// the noise, η errors of the readings that persist from row to row, C the columns of a hypothesis
// and a ~ N(0, I) its amounts. s is larger noise, t are larger tolerances. η(k) has variance τ² and
// correlation ρ^|i - j| between rows i and j of the log (first order autoregression): a Kalman
// filter over the rows whitens y, B and C alike, so that nothing dense is ever made.
#pragma once

#include <vector>

#include "calibration/dense.hpp"

namespace truepose {
/// Rows of a log, their poses eliminated, in σ of the readings.
struct LogRows {
  RowMatrix B;            ///< by the unknowns, in units of the prior's root
  std::vector<double> y;  ///< of unknowns at their prior mean
  RowMatrix D;            ///< by an error of each reading, in its σ
  std::vector<int> line;  ///< row of the log, ascending; -1: a difference between several
};

/// An ordinary explanation of larger residuals; by default none.
struct Ordinary {
  double noise = 1;        ///< s
  double tolerances = 1;   ///< t
  double correlation = 0;  ///< ρ
  double persisting = 0;   ///< τ²
};

/// Hypotheses: their columns, in units of their amounts' σ, one after the other.
struct Columns {
  RowMatrix C;
  std::vector<int> end;  ///< one past the last column of each
};

/// Log of the marginal likelihood under each ordinary explanation (a row each): of no hypothesis
/// first, then of every hypothesis.
RowMatrix weigh(const LogRows& rows, const Columns& columns, const std::vector<Ordinary>& ordinary);
}  // namespace truepose
