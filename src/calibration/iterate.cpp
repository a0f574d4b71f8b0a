// One iterate of a batch calibration, and the equations of the step from it.
#include "calibration/iterate.hpp"

namespace truepose {
int CalibrationIterate::equations() const {
  int sum = 0;
  for (const Line& each : line) sum += each.redundancy();
  for (const LinkBlock& each : block) sum += each.size();
  return sum;
}

void CalibrationIterate::weigh(const LineLoss& loss) {
  for (LinkBlock& each : block) each.weigh(loss);
}

double CalibrationIterate::cost(const LineLoss& loss) const {
  double sum = dot(static_cast<int>(u.size()), u.data(), u.data());
  for (const Line& each : line)
    if (each.redundancy() > 0) sum += each.cost(loss);
  for (const LinkBlock& each : block) sum += each.cost;
  return sum;
}

double CalibrationIterate::spread() const {
  std::vector<double> ratios;
  for (const Line& each : line)
    if (each.redundancy() > 0 && !each.certain) ratios.push_back(each.misfit() / each.redundancy());
  for (const LinkBlock& each : block)
    for (int k = 0; k < each.size(); ++k)
      ratios.push_back(each.y[k] * each.y[k] / (1 + each.shared(k, k)));
  if (ratios.empty()) return 1;
  return std::sqrt(median(ratios) / 0.455);  // the median of χ² with one degree of freedom
}

StepEquations CalibrationIterate::step(const std::vector<double>& counts) const {
  const int p = static_cast<int>(u.size());
  RowMatrix B(equations(), p);
  std::vector<double> y;
  const auto enter = [&](double root, const double* from, double value) {
    add_scaled(p, root, from, B[static_cast<int>(y.size())]);
    y.push_back(root * value);
  };
  for (std::size_t k = 0; k < line.size(); ++k)
    for (int i = line[k].n; i < line[k].rows; ++i)
      enter(std::sqrt(counts[k]), line[k].B[i], line[k].e[i]);
  for (const LinkBlock& each : block) {
    RowMatrix own = each.B, right(each.size(), 1, each.y.data());
    solve_lower(each.C, own);
    solve_lower(each.C, right);
    for (int k = 0; k < each.size(); ++k) enter(1, own[k], right(k, 0));
  }
  StepEquations result{plus_gram(RowMatrix::identity(p), B), u};
  for (double& entry : result.right) entry = -entry;
  for (int row = 0; row < B.rows(); ++row) add_scaled(p, y[row], B[row], result.right.data());
  return result;
}
}  // namespace truepose
