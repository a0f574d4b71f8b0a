// Weight of a row's residual. Against its loss.
#include "calibration/loss.hpp"
#include "check.hpp"

using namespace truepose;

TEST("a weight is the slope of its loss, at most 1, and by squares 1") {
  for (const double unit : {1.0, 30.0, double(INFINITY)})
    for (const int m : {1, 2, 3, 6, 12})
      for (double d2 = 0.05; d2 < 1e6; d2 *= 1.7) {
        const RowLoss loss{unit};
        const double step = 1e-5 * d2, weight = loss.weight(d2, m);
        const double slope = (loss.cost(d2 + step, m) - loss.cost(d2 - step, m)) / (2 * step);
        CHECK_NEAR(weight, slope, 1e-6);
        CHECK(weight > 0 && weight <= 1 && (weight == 1) == (unit == INFINITY));
      }
}

TEST("noise of a row's unit leaves it no outlier, 20 units do") {
  for (const int m : {1, 2, 3, 6, 12}) {
    CHECK(RowLoss{3}.weight(9 * (m + 5 * std::sqrt(2 * m)), m) > kOutlier);
    CHECK(RowLoss{3}.weight(9 * 400, m) < kOutlier);
  }
}
