// One iterate of a batch calibration, and the equations of the step from it.
#include "calibration/iterate.hpp"

#include "math/chi2.hpp"

namespace truepose {
namespace {
/// χ² that is exceeded with this probability, by degrees of freedom from 0.
std::array<double, kMaxRows + 1> beyond(double probability) {
  std::array<double, kMaxRows + 1> result{};
  for (int m = 1; m <= kMaxRows; ++m) result[m] = chi2_beyond(probability, m);
  return result;
}
}  // namespace

void CalibrationIterate::weigh(const RowLoss& loss, const Outliers& out) {
  for (std::size_t k = 0; k < line.size(); ++k) line[k].outlier = out.line[k];
  for (LinkBlock& each : block) each.weigh(loss, out.link);
}

double CalibrationIterate::cost(const RowLoss& loss) const {
  double sum = dot(static_cast<int>(u.size()), u.data(), u.data());
  for (const Line& each : line)
    if (each.redundancy() > 0) sum += each.cost(loss);
  for (const LinkBlock& each : block) sum += each.cost;
  return sum;
}

double CalibrationIterate::spread() const {
  const auto middle = beyond(0.5);
  std::vector<double> ratios;
  for (const Line& each : line)
    if (each.redundancy() > 0 && !each.certain && !each.outlier)
      ratios.push_back(each.misfit() / middle[each.redundancy()]);
  for (const LinkBlock& each : block)
    for (int k = 0; k < each.size(); ++k)
      if (each.weight[k] > kNothing)
        ratios.push_back(each.y[k] * each.y[k] / (1 + each.shared(k, k)) / middle[1]);
  return ratios.empty() ? 1 : std::sqrt(median(ratios));
}

Outliers CalibrationIterate::outliers(const Links& links, double scale) const {
  const RowMatrix root = cholesky(step({}).information);
  const auto most = beyond(kFalse / static_cast<double>(line.size() + links.link.size()));
  const double square = scale * scale;
  std::vector<LinkResult> found(links.link.size());
  for (const LinkBlock& each : block) cross_validate(links, each, root, found);
  Outliers result;
  for (const Line& each : line)
    result.line.push_back(!each.certain && each.left_out(root) > square * most[each.redundancy()]);
  for (const LinkResult& each : found)
    result.link.push_back(each.left_out * each.left_out >
                          square * most[1] * each.sigma * each.sigma);
  return result;
}

StepEquations CalibrationIterate::step(const RowLoss& loss) const {
  const int p = static_cast<int>(u.size());
  RowMatrix B(equations(), p);
  std::vector<double> y;
  each_equation(line, block, [&](const double* from, double value, int k, bool linked) {
    const double root = linked ? 1 : std::sqrt(line[k].weight(loss));
    add_scaled(p, root, from, B[static_cast<int>(y.size())]);
    y.push_back(root * value);
  });
  StepEquations result{plus_gram(RowMatrix::identity(p), B), u};
  for (double& entry : result.right) entry = -entry;
  for (int row = 0; row < B.rows(); ++row) add_scaled(p, y[row], B[row], result.right.data());
  return result;
}
}  // namespace truepose
