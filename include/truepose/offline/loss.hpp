// Robust losses of a row's disagreement, and the row's weight.
//
// A line leaves m equations about ξ, whitened: y = R u + e, e normal with unit covariance. It costs
// ρ(d²), d² = |y - R u|², and so pulls by ψ(e) = w e with w = dρ/d(d²). Its pull is isotropic,
// hence
//   E[∂ψ/∂e] = a I,  E[ψψᵀ] = b I,  a = E[w d²]/m (Stein),  b = E[w² d²]/m,  d² ~ χ²_m,
// and an estimate from such lines alone has the covariance A⁻¹BA⁻¹ = b/a² (Σ RᵀR)⁻¹ (Huber,
// Robust Statistics, 1981, chapter 6): a line is worth a²/b RᵀR. Its own w says nothing of that: it
// is large where the fit happens to be close. Beside a prior, and beside lines of another m, each
// loss counts a/b times: then A = B, as it is for a likelihood, and what is known is I + Σ a²/b
// RᵀR.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "truepose/math/eliminate.hpp"

namespace truepose {

/// What a disagreement between the readings of one pose costs.
enum class Loss : int {
  squares = 0,  ///< d²: normal errors
  huber = 1,    ///< linear beyond `tuning`, constant beyond kGross
  student = 2,  ///< (ν + m) log(1 + d²/ν), ν = `tuning`: gross errors count for nothing
};

/// Residual of a line, in units of its σ, that no noise explains. Huber's force is bounded, not its
/// lever: a reading so wrong that its pose is outside the workspace would pull all the same.
inline constexpr double kGross = 30;

/// s w below which a line is an outlier. Noise brings none there (d is then 7 to 20), so that such
/// a line is no draw from the model that its expected information assumes: it has none.
inline constexpr double kOutlier = 0.1;

/// The loss of lines, by the number m of their equations.
class LineLoss {
 public:
  LineLoss(Loss loss, double tuning) : loss_(loss), tuning_(tuning) {
    a_.fill(1);
    b_.fill(1);
    if (loss != Loss::squares)
      for (int m = 1; m <= kMaxRows; ++m) expect(m);
  }

  double rho(double d2, int m) const {
    const double c = tuning_;
    switch (loss_) {
      case Loss::huber: return d2 > c * c ? 2 * c * std::min(std::sqrt(d2), kGross) - c * c : d2;
      case Loss::student: return (c + m) * std::log1p(d2 / c);
      default: return d2;
    }
  }
  double weight(double d2, int m) const {
    const double c = tuning_;
    switch (loss_) {
      case Loss::huber: return d2 > kGross * kGross ? 0 : d2 > c * c ? c / std::sqrt(d2) : 1;
      case Loss::student: return (c + m) / (c + d2);
      default: return 1;
    }
  }
  /// How many times a line's loss counts: a/b.
  double scale(int m) const { return a_[m] / b_[m]; }
  /// What a line is expected to be worth, as a part of RᵀR: a²/b.
  double information(int m) const { return a_[m] * a_[m] / b_[m]; }

 private:
  /// a and b by the trapezoidal rule: d has a density like d^(m-1) exp(-d²/2), and E[d²] = m.
  void expect(int m) {
    constexpr double kStep = 0.02;
    const double mode = std::sqrt(m + 1.0);  // of d² times the density
    double whole = 0, first = 0, second = 0;
    for (double d = kStep; d < mode + 9; d += kStep) {
      const double density = std::exp((m + 1) * std::log(d / mode) - 0.5 * (d * d - mode * mode));
      const double w = weight(d * d, m);
      whole += density;
      first += w * density;
      second += w * w * density;
    }
    a_[m] = first / whole;
    b_[m] = second / whole;
  }

  Loss loss_;
  double tuning_;
  std::array<double, kMaxRows + 1> a_, b_;
};

}  // namespace truepose
