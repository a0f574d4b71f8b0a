// Marginal likelihood of rows. Against the dense Gaussian density.
#include "calibration/evidence.hpp"

#include <cmath>
#include <numbers>

#include "check.hpp"
#include "reference.hpp"

using namespace truepose;
using reference::Dense;

namespace {

RowMatrix drawn(check::Random& random, int rows, int columns) {
  RowMatrix result(rows, columns);
  for (double& entry : result) entry = random();
  return result;
}

/// Eleven equations of five rows, one left out, and a difference; hypotheses of 1, 3 and 2 columns.
struct Scene {
  check::Random random{3};
  LogRows rows{drawn(random, 11, 4),
               std::vector<double>(11),
               drawn(random, 11, 3),
               {0, 0, 1, 1, 2, 4, 4, 4, 5, 5, -1}};
  Columns columns{drawn(random, 11, 6), {1, 4, 6}};
  Scene() {
    for (double& y : rows.y) y = 3 * random();
  }

  double density(const Ordinary& by, int first, int last) const {
    const Dense B = reference::dense(rows.B), D = reference::dense(rows.D);
    const Dense C = reference::dense(columns.C).middleCols(first, last - first);
    Dense V = by.tolerances * by.tolerances * B * B.transpose() + C * C.transpose();
    const double s2 = by.noise * by.noise;
    for (int i = 0; i < V.rows(); ++i)
      for (int j = 0; j < V.rows(); ++j) {
        const int a = rows.line[i], b = rows.line[j];
        if (i == j) V(i, j) += s2;
        if (a >= 0 && b >= 0)
          V(i, j) += s2 * by.persisting * std::pow(by.correlation, std::abs(a - b)) *
                     D.row(i).dot(D.row(j));
      }
    const Eigen::VectorXd y = reference::dense(rows.y);
    return -0.5 * (y.dot(reference::inverse(V) * y) + std::log(reference::determinant(V)) +
                   static_cast<double>(y.size()) * std::log(2 * std::numbers::pi));
  }
};

}  // namespace

TEST("every hypothesis has the likelihood of the dense Gaussian, beside ordinary explanations") {
  const Scene scene;
  const std::vector<Ordinary> ordinary{{},
                                       {2, 1, 0, 0},
                                       {1, 4, 0, 0},
                                       {0.5, 3, 0, 0},
                                       {1, 1, 0.5, 2},
                                       {3, 2, 0.5, 2},
                                       {1, 1, 0.9, 30}};
  const RowMatrix found = weigh(scene.rows, scene.columns, ordinary);
  for (int a = 0; a < found.rows(); ++a) {
    CHECK_NEAR(found(a, 0), scene.density(ordinary[a], 0, 0), 1e-9);
    int first = 0;
    for (int h = 0; h < 3; ++h) {
      CHECK_NEAR(found(a, h + 1), scene.density(ordinary[a], first, scene.columns.end[h]), 1e-9);
      first = scene.columns.end[h];
    }
  }
}
