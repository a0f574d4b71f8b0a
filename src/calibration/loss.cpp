// Loss of a row's residual, squares or Student's, and the row's weight.
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
  return loss_ == Loss::squares ? d2 : (tuning_ + m) * std::log1p(d2 / tuning_);
}

double LineLoss::weight(double d2, int m) const {
  return loss_ == Loss::squares ? 1 : (tuning_ + m) / (tuning_ + d2);
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
