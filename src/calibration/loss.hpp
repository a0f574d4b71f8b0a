// Loss of a row's residual, squares or Student's, and the row's weight.
//
// A row leaves m equations on ξ, whitened: y = R u + e, e normal with unit covariance. Its cost is
// ρ(d²), d² = |y - R u|², and its influence ψ(e) = w e with w = dρ/d(d²). As this is isotropic,
//   E[∂ψ/∂e] = a I,  E[ψψᵀ] = b I,  a = E[w d²]/m (Stein),  b = E[w² d²]/m,  d² ~ χ²_m,
// and an estimate from such rows alone has the covariance A⁻¹BA⁻¹ = b/a² (Σ RᵀR)⁻¹ (Huber, Robust
// Statistics, 1981, chapter 6): a row contributes a²/b RᵀR. Its own w is no measure of that: it is
// large where the fit happens to be close. Together with a prior, and with rows of another m, each
// loss is scaled by a/b: then A = B, as for a likelihood, and the information is I + Σ a²/b RᵀR.
#pragma once

#include <array>

#include "math/eliminate.hpp"

namespace truepose {
/// Cost of the residual of one pose's readings.
enum class Loss : int {
  squares = 0,  ///< d²: normal errors
  student = 1,  ///< (ν + m) log(1 + d²/ν), ν = `tuning`: gross errors have no influence
};

/// s w below which a row is an outlier. Noise does not get there (d is then 7 to 20), so the
/// model behind the expected information excludes such a row: it contributes none.
inline constexpr double kOutlier = 0.1;

/// Loss of rows, by the number m of their equations.
class LineLoss {
 public:
  LineLoss(Loss loss, double tuning);

  double rho(double d2, int m) const;
  double weight(double d2, int m) const;
  double unit = 1;  ///< σ of a residual d for cost and factor, > 1 at first

  /// Cost of a row, and its weight times a/b.
  double cost(double d2, int m) const;
  double factor(double d2, int m) const { return scale(m) * weight(d2 / (unit * unit), m); }

  /// Scale of a row's loss: a/b.
  double scale(int m) const { return a_[m] / b_[m]; }
  /// Expected information of a row, as a fraction of RᵀR: a²/b.
  double information(int m) const { return a_[m] * a_[m] / b_[m]; }

 private:
  /// a and b by the trapezoidal rule: d has a density like d^(m-1) exp(-d²/2), and E[d²] = m.
  void expect(int m);

  Loss loss_;
  double tuning_;
  std::array<double, kMaxRows + 1> a_, b_;
};
}  // namespace truepose
