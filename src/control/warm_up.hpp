// Warm-up: base, arms and rods grow with temperature, each by a share of its size.
//
// The parity of a grown robot is M τ, with three growths τ in units of σ and a prior N(0, 1). They
// follow from the mean over some minutes of Mᵀ V⁻¹ p and Mᵀ V⁻¹ M, which counts as one measurement:
// the rest of the geometry errs alike at neighbouring poses. Faster drifts remain in p - M τ.
#pragma once

#include "control/parity.hpp"
#include "math/ldlt.hpp"

namespace truepose {
inline constexpr int kGrowths = 3;      ///< of base, arms and rods
inline constexpr Real kMostGrowth = 3;  ///< σ, largest growth
using Growths = std::array<Real, kGrowths>;
using GrowthRows = Matrix<kMaxSensors, kGrowths>;

/// M at the parity's pose. @param PH  P H_ξ @param growth  largest shares of the sizes
GrowthRows growth_rows(const Robot& robot, const Real* PH, const Growths& growth);

/// Estimated growths.
struct WarmUp {
  Matrix<kGrowths, kGrowths> information{};  ///< mean of Mᵀ V⁻¹ M
  Growths score{};                           ///< and of Mᵀ V⁻¹ p,
  Real averaged = 0;                         ///< over so many seconds, up to the memory
  bool warm = false;                         ///< only the growths explain the parity

  /// Adds a parity to the means. @param V  of the geometry without growth, factored
  /// @param since  s, the last one @param memory  s
  void average(const GrowthRows& M, const ReadingCovariance& V, const Reading& p, int r, Real since,
               Real memory);

  /// Adds the estimate's covariance to the geometry's. @return M τ
  Reading explain(const GrowthRows& M, int r, Matrix<kMaxSensors, kMaxSensors>& geometry) const;
};
}  // namespace truepose
