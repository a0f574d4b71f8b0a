// One iterate of a batch calibration, and the equations of the step from it.
#pragma once

#include "calibration/links.hpp"

namespace truepose {
/// Information on u, I + Σ c RᵀR, and the right side, Σ c Rᵀy - u.
struct StepEquations {
  RowMatrix information;
  std::vector<double> right;
};

/// A geometry, its poses and the linearised readings there.
struct CalibrationIterate {
  std::vector<double> u;
  std::vector<Pose> pose;
  std::vector<Coordinates> pull;  ///< of every pose, due to the links: ν̂
  std::vector<Line> line{};
  std::vector<LinkBlock> block{};

  int equations() const;
  void weigh(const LineLoss& loss);
  double cost(const LineLoss& loss) const;
  /// √(median of d²/r): robust scale of the rows' residuals.
  double spread() const;
  /// @param counts  c of every row
  StepEquations step(const std::vector<double>& counts) const;
};
}  // namespace truepose
