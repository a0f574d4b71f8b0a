// One iterate of a batch calibration, and the equations of the step from it.
#pragma once

#include "calibration/links.hpp"
#include "math/chi2.hpp"

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

/// χ² that is exceeded with this probability, by degrees of freedom from 0.
inline std::array<double, kMaxRows + 1> chi2_table(double probability) {
  std::array<double, kMaxRows + 1> table;
  for (int m : range(kMaxRows + 1)) table[m] = chi2_beyond(probability, m);
  return table;
}

/// A geometry, its poses and the linearised readings there.
struct CalibrationIterate {
  std::vector<double> u;
  std::vector<Pose> pose;
  std::vector<Line> line{};
  std::vector<LinkBlock> block{};

  void weigh(const RowLoss& loss, const Outliers& out) {
    for (std::size_t k = 0; k < line.size(); ++k) line[k].outlier = out.line[k];
    for (LinkBlock& each : block) each.weigh(loss, out.link);
  }

  double cost(const RowLoss& loss) const {
    double sum = dot(int(u.size()), u.data(), u.data());
    for (const Line& each : line)
      if (each.redundancy() > 0) sum += each.cost(loss);
    for (const LinkBlock& each : block) sum += each.cost;
    return sum;
  }

  /// Robust scale of the residuals that count: √ of the median d² over that of χ².
  double spread() const {
    const auto middle = chi2_table(0.5);
    std::vector<double> ratios;
    for (const Line& each : line)
      if (each.redundancy() > 0 && !each.certain && !each.outlier)
        ratios.push_back(each.misfit() / middle[each.redundancy()]);
    for (const LinkBlock& each : block)
      for (int k : range(each.size()))
        if (each.weight[k] > kNothing)
          ratios.push_back(each.y[k] * each.y[k] / (1 + each.shared(k, k)) / middle[1]);
    return ratios.empty() ? 1 : sqrt(median(ratios));
  }

  StepEquations step(const RowLoss& loss) const {
    const int p = int(u.size());
    RowMatrix B(equation_count(line, block), p);
    StepEquations result{RowMatrix::identity(p), u};
    for (double& entry : result.right) entry = -entry;
    int row = 0;
    each_equation(line, block, [&](const double* from, double y, int k, bool linked) {
      const double root = linked ? 1 : sqrt(line[k].weight(loss));
      add_scaled(p, root, from, B[row]);
      add_scaled(p, root * y, B[row++], result.right.data());
    });
    result.information = plus_gram(std::move(result.information), B);
    return result;
  }

  /// Rows and differences whose error, predicted by all others that count, noise explains with a
  /// probability below `kFalse` per log. @param scale  of the stated σ
  Outliers outliers(const Links& links, double scale) const {
    const RowMatrix root = cholesky(step({}).information);
    const auto most = chi2_table(kFalse / double(line.size() + links.link.size()));
    const double square = scale * scale;
    std::vector<LinkResult> found(links.link.size());
    for (const LinkBlock& each : block) cross_validate(links, each, root, found);
    Outliers result;
    for (const Line& each : line)
      result.line.push_back(!each.certain &&
                            each.left_out(root) > square * most[each.redundancy()]);
    for (const LinkResult& each : found)
      result.link.push_back(each.left_out * each.left_out >
                            square * most[1] * each.sigma * each.sigma);
    return result;
  }
};
}  // namespace truepose
