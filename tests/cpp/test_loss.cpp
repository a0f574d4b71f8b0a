// Expected weight of a row under a robust loss. Against integrals over its definition.
#include "calibration/loss.hpp"
#include "check.hpp"

using namespace truepose;

namespace {

constexpr int kEquations[] = {1, 2, 3, 6, 12, kMaxRows};

struct Case {
  Loss loss;
  double tuning;
};
constexpr Case kCases[] = {{Loss::student, 1.5}, {Loss::student, 4}, {Loss::student, 30}};

/// E[f(d)] with d² ~ χ²_m, by Simpson's rule on the density of d.
template <class F>
double expected(int m, F&& f) {
  constexpr double kStep = 1e-3, kLast = 20;
  const auto value = [&](double d) {
    const double log_density =
        (m - 1) * std::log(d) - 0.5 * d * d - (0.5 * m - 1) * std::log(2) - std::lgamma(0.5 * m);
    return std::exp(log_density) * f(d);
  };
  double sum = 0;
  for (double d = 1e-9; d < kLast; d += kStep)
    sum += kStep / 6 * (value(d) + 4 * value(d + 0.5 * kStep) + value(d + kStep));
  return sum;
}

}  // namespace

TEST("the scale and the information of a line are those of Huber's sandwich") {
  for (const auto& [loss, tuning] : kCases) {
    const LineLoss line(loss, tuning);
    for (const int m : kEquations) {
      const auto weight = [&](double d) { return line.weight(d * d, m); };
      // ∂ψ/∂e of ψ = w e, averaged over the directions of e: w + w'(d) d / m.
      const double a = expected(m, [&](double d) {
        constexpr double kStep = 1e-5;
        const double slope = (weight(d + kStep) - weight(std::max(d - kStep, 0.0))) /
                             (d < kStep ? kStep : 2 * kStep);
        return weight(d) + slope * d / m;
      });
      const double b = expected(m, [&](double d) { return weight(d) * weight(d) * d * d / m; });
      CHECK_NEAR(line.scale(m), a / b, 1e-4 * a / b);
      CHECK_NEAR(line.information(m), a * a / b, 1e-4);
    }
  }
}

TEST("no loss makes a line worth more than squares do, and mild ones make it worth as much") {
  for (int m = 1; m <= kMaxRows; ++m) {
    CHECK(LineLoss(Loss::squares, 0).scale(m) == 1);
    CHECK(LineLoss(Loss::squares, 0).information(m) == 1);
    for (const auto& [loss, tuning] : kCases) {
      CHECK(LineLoss(loss, tuning).information(m) < 1);
      CHECK(LineLoss(loss, tuning).information(m) > 0.6);
    }
    CHECK_NEAR(LineLoss(Loss::student, 1e6).information(m), 1, 1e-9);
  }
}

TEST("a weight is the slope of its loss") {
  for (const auto& [loss, tuning] : kCases) {
    const LineLoss line(loss, tuning);
    for (const int m : kEquations)
      for (double d2 = 0.05; d2 < 100; d2 *= 1.3) {
        const double step = 1e-5 * d2;
        const double slope = (line.rho(d2 + step, m) - line.rho(d2 - step, m)) / (2 * step);
        CHECK_NEAR(line.weight(d2, m), slope, 1e-6);
      }
  }
}
