// Cost of a row's residual and the row's weight, while gross errors are searched.
#pragma once

#include <cmath>

namespace truepose {
/// Squares; with a finite unit, Student's loss, under which gross errors have almost no influence.
struct RowLoss {
  double unit = INFINITY;  ///< σ of a residual d

  /// Of a row of m equations: dρ/d(d²).
  double weight(double d2, int m) const { return 1 / (1 + d2 / wide(m)); }
  /// ρ(d²).
  double cost(double d2, int m) const {
    return unit < INFINITY ? wide(m) * std::log1p(d2 / wide(m)) : d2;
  }

 private:
  /// Student's degrees of freedom, 4, and d² of noise.
  double wide(int m) const { return (4 + m) * unit * unit; }
};

/// Weight below which a row is an outlier at first: d is then above 6.7 units.
inline constexpr double kOutlier = 0.1;
}  // namespace truepose
