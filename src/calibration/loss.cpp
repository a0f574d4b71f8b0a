// Robust losses of a row's residual, and the row's weight.
#include "calibration/loss.hpp"

#include <algorithm>
#include <cmath>

namespace truepose {
LineLoss::LineLoss(Loss loss, double tuning) : loss_(loss), tuning_(tuning) {
  a_.fill(1);
  b_.fill(1);
  if (loss != Loss::squares)
    for (int m = 1; m <= kMaxRows; ++m) expect(m);
}

double LineLoss::rho(double d2, int m) const {
  const double c = tuning_;
  switch (loss_) {
    case Loss::huber: return d2 > c * c ? 2 * c * std::min(std::sqrt(d2), kGross) - c * c : d2;
    case Loss::student: return (c + m) * std::log1p(d2 / c);
    default: return d2;
  }
}

double LineLoss::weight(double d2, int m) const {
  const double c = tuning_;
  switch (loss_) {
    case Loss::huber: return d2 > kGross * kGross ? 0 : d2 > c * c ? c / std::sqrt(d2) : 1;
    case Loss::student: return (c + m) / (c + d2);
    default: return 1;
  }
}

double LineLoss::cost(double d2, int m) const {
  return unit * unit * scale(m) * rho(d2 / (unit * unit), m);
}

void LineLoss::expect(int m) {
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
}  // namespace truepose
