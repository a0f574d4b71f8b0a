// The (Bayesian, linear-Gaussian) Cramér-Rao bound of the pose.
#pragma once

#include <Eigen/Cholesky>
#include <functional>
#include <vector>

#include "calibration/links.hpp"

namespace truepose {
/// A pose at which readings are taken, and other information on it.
struct Visit {
  Pose pose;
  Outside outside;
  Influences influences{};
};

/// Information of visits on ξ: rows y = B δξ + ε of unit noise, the poses eliminated.
struct VisitRows {
  RowMatrix B;             ///< per unit of each parameter (m, rad, one)
  std::vector<int> visit;  ///< visit of each row; for a link the first of its block
};

/// Computes the rows of readings at these poses, unknown apart from external measurements.
/// @param prior  of ξ, its auxiliary unknowns, then the amounts of influences and `nuisances` model
///               errors of the ideal level (model_error.hpp); its root is not used
/// @param links  differences measured between these poses; their unknowns follow ξ
/// @param poll   called after every pose; may throw to abort
/// @return the first outcome that is not ok; `chain` is then the faulty chain
inline Outcome rows_of_visits(
    const Robot& robot, const Kernels& model, const Knowledge& prior, int nuisances,
    const std::vector<Visit>& visits, const Links& links, VisitRows& all,
    const std::function<void()>& poll = [] {}) {
  if (!robot.finished) return {Status::unfinished, -1};
  const int p = prior.count;
  Knowledge raw = prior;
  raw.root = nullptr;
  Knowledge axes = raw;
  axes.count = nuisances;
  axes.column += p - nuisances;
  RowMatrix D;
  std::vector<double> H_xi(2 * (model.n + robot.r) * parameter_count(robot));
  long rows = static_cast<long>(links.link.size());
  for (const Visit& visit : visits) rows += robot.r + (visit.outside.x ? model.n : 0);
  all.B.resize(rows, p);
  all.visit.clear();
  std::vector<Pose> poses;
  std::vector<Line> lines;  // only where there are links
  Line line;
  Parasitic rest;
  long row = 0;
  for (const Visit& visit : visits) {
    Outcome outcome = acting(model, robot, axes, visit.pose, visit.influences, H_xi.data(), D);
    if (outcome)
      outcome = linearise_line(model, robot, raw, visit.pose, nullptr, visit.outside,
                               D.cols() > 0 ? &D : nullptr, H_xi.data(), line, rest);
    if (!outcome) return outcome;
    for (int i = model.n; i < line.rows; ++i) {
      all.B.row(row++) = line.B.row(i);
      all.visit.push_back(static_cast<int>(&visit - visits.data()));
    }
    if (!links.link.empty()) {
      poses.push_back(visit.pose);
      lines.push_back(line);
    }
    poll();
  }
  if (!links.link.empty())
    for (const LinkBlock& block :
         linked(model.mobility, links, links.mean.data(), raw, poses, lines)) {
      all.B.middleRows(row, block.size()) = block.C.matrixL().solve(block.B);
      all.visit.insert(all.visit.end(), block.size(), links.link[block.link[0]].line[0]);
      row += block.size();
    }
  all.B.conservativeResize(row, p);
  return {};
}

/// Computes the posterior of ξ after readings at these poses: with u the parameters in units of the
/// prior, Σ_u⁻¹ = I + Σ BᵀB over the rows after elimination.
/// @param prior, nuisances, visits, links, poll  as for rows_of_visits
/// @param root  out: lower triangular, Σ_ξ = root rootᵀ after the visits
inline Outcome after_visiting(
    const Robot& robot, const Kernels& model, const Knowledge& prior, int nuisances,
    const std::vector<Visit>& visits, const Links& links, RowMatrix& root,
    const std::function<void()>& poll = [] {}) {
  VisitRows all;
  const Outcome outcome = rows_of_visits(robot, model, prior, nuisances, visits, links, all, poll);
  if (!outcome) return outcome;
  const int p = prior.count;
  // S is applied last, once: elimination acts on the rows, S on the columns.
  const Eigen::MatrixXd S =
      Eigen::Map<const RowMatrix>(prior.root, p, p).triangularView<Eigen::Lower>();
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(p, p);
  if (all.B.rows() > 0)  // Eigen divides by it
    N.selfadjointView<Eigen::Lower>().rankUpdate(all.B.transpose());
  const Eigen::MatrixXd NS = N.selfadjointView<Eigen::Lower>() * S;
  // I + SᵀNS = U Uᵀ with U upper triangular (Cholesky from the last parameter to the first), so
  // that Σ_u = U⁻ᵀ U⁻¹, and the root is S U⁻ᵀ, lower times lower.
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(p, p);
  information.noalias() += S.transpose() * NS;
  information = information.reverse().eval();
  const Eigen::MatrixXd L = information.llt().matrixL();
  const Eigen::MatrixXd UT = L.transpose().reverse();
  const Eigen::MatrixXd inverse =
      UT.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(p, p));
  root = S.triangularView<Eigen::Lower>() * inverse;
  return {};
}

/// Computes the fusion of all readings at a pose, with the weights of that pose.
/// @param acting   influences, whose amounts are the last known quantities
/// @param H_xi, B  work space, as for reading_covariance
Outcome fused(const Robot& robot, const Kernels& model, const Knowledge& known, const Pose& pose,
              const Influences& acting, double* H_xi, double* B, Fused& fusion);

/// Errors of x̂ at a pose: due to ξ, in units of the knowledge's root, and due to the readings.
struct PoseError {
  RowMatrix by_geometry;  ///< n×p
  RowMatrix by_noise;     ///< covariance, n×n
};

Outcome pose_error(const Robot& robot, const Kernels& model, const Knowledge& known,
                   const Pose& pose, const Influences& acting, std::vector<double>& work,
                   PoseError& error);
}  // namespace truepose
