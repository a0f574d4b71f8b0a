// Input, iterates and output of a batch calibration.
#pragma once

#include <functional>
#include <vector>

#include "calibration/links.hpp"

namespace truepose {
/// Settings of a batch calibration.
struct CalibrationSettings {
  int influences = 0;     ///< number of amounts of influences, unknowns before the nuisances
  int nuisances = 0;      ///< number of the prior's last parameters, for left_out; independent
  int registration = -1;  ///< first of the prior's kRegistration registration unknowns, or -1
  Loss loss = Loss::squares;
  double tuning = 0;
  int iterations = 100;
  std::function<void()> poll;  ///< called after every row, if set; may throw to abort
};

/// Readings at unknown poses, with any external measurements there. NaN: not read.
struct ReadingLog {
  int count = 0;
  const double* q_e = nullptr;             ///< count × (n + r)
  const double* influence = nullptr;       ///< count × (n + r) × influences: effect of one unit
  const double* measured = nullptr;        ///< count × n coordinates, or nullptr
  const double* measured_sigma = nullptr;  ///< σ of those, > 0
  Registration registration{};             ///< of those; initial marker where it is unknown
  Links links{};                           ///< measured differences between its poses
  int referenced = 0;  ///< number of last rows, measured in the base frame; never outliers
};

/// Information on u, I + Σ c RᵀR, and the right side, Σ c Rᵀy - u.
struct StepEquations {
  Eigen::MatrixXd information;
  Eigen::VectorXd right;
};

/// A geometry, its poses and the linearised readings there.
struct CalibrationIterate {
  Eigen::VectorXd u;
  std::vector<Pose> pose;
  std::vector<Coordinates> pull;  ///< of every pose, due to the links: ν̂
  std::vector<Line> line{};
  std::vector<LinkBlock> block{};

  int equations() const {
    int sum = 0;
    for (const Line& each : line) sum += each.redundancy();
    for (const LinkBlock& each : block) sum += each.size();
    return sum;
  }

  void weigh(const LineLoss& loss) {
    for (LinkBlock& each : block) each.weigh(loss);
  }

  double cost(const LineLoss& loss) const {
    double sum = u.squaredNorm();
    for (const Line& each : line)
      if (each.redundancy() > 0) sum += each.cost(loss);
    for (const LinkBlock& each : block) sum += each.cost;
    return sum;
  }

  /// √(median of d²/r): robust scale of the rows' residuals.
  double spread() const {
    std::vector<double> ratios;
    for (const Line& each : line)
      if (each.redundancy() > 0 && !each.certain)
        ratios.push_back(each.misfit() / each.redundancy());
    for (const LinkBlock& each : block)
      for (int k = 0; k < each.size(); ++k)
        ratios.push_back(each.y[k] * each.y[k] / (1 + each.shared(k, k)));
    if (ratios.empty()) return 1;
    return std::sqrt(median(ratios) / 0.455);  // the median of χ² with one degree of freedom
  }

  /// @param p  number of unknowns @param counts  c of a row
  template <class F>
  StepEquations equations_of_step(int p, F&& counts) const {
    RowMatrix stacked(equations(), p);
    Eigen::VectorXd y(equations());
    int row = 0;
    for (const Line& each : line) {
      if (each.redundancy() == 0) continue;
      const double root = std::sqrt(counts(each));
      for (int i = each.n; i < each.rows; ++i, ++row) {
        stacked.row(row) = root * each.B.row(i);
        y[row] = root * each.e[i];
      }
    }
    for (const LinkBlock& each : block) {
      stacked.middleRows(row, each.size()) = each.C.matrixL().solve(each.B);
      y.segment(row, each.size()) = each.C.matrixL().solve(each.y);
      row += each.size();
    }
    StepEquations result{Eigen::MatrixXd::Identity(p, p), stacked.transpose() * y - u};
    if (row > 0)  // Eigen divides by it
      result.information.selfadjointView<Eigen::Lower>().rankUpdate(stacked.transpose());
    return result;
  }
};

/// Result of a batch calibration, by row of the log and overall.
struct CalibrationResult {
  Outcome outcome;
  int iterations = 0;
  std::vector<double> xi;      ///< parameter_count(drawn) values
  Eigen::VectorXd u;           ///< ξ̂ of the uncertain ones: μ + S u
  Eigen::MatrixXd covariance;  ///< of the uncertain parameters, nuisances left out
  Registration start;          ///< registration at zero unknowns
  Registration registration;
  std::vector<Pose> pose;        ///< x̂ of every row of the log
  std::vector<Status> status;    ///< of every row; one that is not ok was excluded
  std::vector<double> chi2;      ///< d² of every row
  std::vector<int> redundancy;   ///< equations of a row that remain for ξ
  std::vector<double> weight;    ///< of every row: 1, or less for an outlier
  std::vector<LinkResult> link;  ///< of every measured difference
  std::vector<double> w;         ///< the unknowns of those
  std::vector<double> amount;    ///< of every influence
  double cost = 0;
};
}  // namespace truepose
