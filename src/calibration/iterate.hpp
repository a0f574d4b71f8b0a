// One iterate of a batch calibration, and the equations of the step from it.
#pragma once

#include "calibration/links.hpp"

namespace truepose {
/// Probability that an outlier is found in a healthy log.
inline constexpr double kFalse = 1e-3;

/// Information on u, I + Σ w RᵀR, and the right side, Σ w Rᵀy - u.
struct StepEquations {
  RowMatrix information;
  std::vector<double> right;
};

/// Rows and differences of a log that do not count.
struct Outliers {
  std::vector<char> line, link;
  bool operator==(const Outliers&) const = default;
};

/// A geometry, its poses and the linearised readings there.
struct CalibrationIterate {
  std::vector<double> u;
  std::vector<Pose> pose;
  std::vector<Coordinates> pull;  ///< of every pose, due to the links: ν̂
  std::vector<Line> line{};
  std::vector<LinkBlock> block{};

  int equations() const { return equation_count(line, block); }
  void weigh(const RowLoss& loss, const Outliers& out);
  double cost(const RowLoss& loss) const;
  /// Robust scale of the residuals that count: √ of the median d² over that of χ².
  double spread() const;
  StepEquations step(const RowLoss& loss) const;
  /// Rows and differences whose error, predicted by all others that count, noise explains with a
  /// probability below `kFalse` per log. @param scale  of the stated σ
  Outliers outliers(const Links& links, double scale) const;
};
}  // namespace truepose
