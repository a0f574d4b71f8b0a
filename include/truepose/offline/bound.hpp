// How accurate can the pose be known at best? The (Bayesian, linear-Gaussian) Cramér-Rao bound.
#pragma once

#include <Eigen/Cholesky>
#include <functional>
#include <vector>

#include "truepose/offline/line.hpp"

namespace truepose {

/// A pose at which readings are taken, and what else is known of it.
struct Visit {
  Pose pose;
  Outside outside;
};

/// What readings at these poses leave unknown of ξ, poses unknown too but for what was measured
/// from outside: with u the parameters in units of the prior, Σ_u⁻¹ = I + Σ BᵀB over the rows that
/// elimination leaves.
/// @param prior  of ξ, and behind it of `nuisances`, what the ideal level leaves out (guarded.hpp)
/// @param poll  called after every pose; may throw to end it all
/// @param root  out: lower triangular, Σ_ξ = root rootᵀ after the visit
/// @return the first outcome that is not ok; `chain` is then the chain at fault
inline Outcome after_visiting(
    const Robot& robot, const Kernels& model, const Knowledge& prior, int nuisances,
    const std::vector<Visit>& visits, RowMatrix& root, const std::function<void()>& poll = [] {}) {
  if (!robot.finished) return {Status::unfinished, -1};
  const int p = prior.count;
  Knowledge raw = prior;  // S comes last, once: elimination acts on the rows, S on the columns
  raw.root = nullptr;
  Knowledge axes = raw;
  axes.count = nuisances;
  axes.column += p - nuisances;
  RowMatrix D;
  std::vector<double> H_xi(2 * (model.n + robot.r) * parameter_count(robot));
  long rows = 0;
  for (const Visit& visit : visits) rows += robot.r + (visit.outside.x ? model.n : 0);
  RowMatrix stacked(rows, p);
  Line line;
  Parasitic rest;
  long row = 0;
  for (const Visit& visit : visits) {
    Outcome outcome;
    if (nuisances > 0) outcome = model.left_out(robot, axes, visit.pose, H_xi.data(), D);
    if (outcome)
      outcome = read(model, robot, raw, visit.pose, nullptr, visit.outside,
                     nuisances > 0 ? &D : nullptr, H_xi.data(), line, rest);
    if (!outcome) return outcome;
    for (int i = model.n; i < line.rows; ++i) stacked.row(row++) = line.B.row(i);
    poll();
  }
  const Eigen::MatrixXd S =
      Eigen::Map<const RowMatrix>(prior.root, p, p).triangularView<Eigen::Lower>();
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(p, p);
  if (row > 0)  // Eigen divides by it
    N.selfadjointView<Eigen::Lower>().rankUpdate(stacked.topRows(row).transpose());
  const Eigen::MatrixXd NS = N.selfadjointView<Eigen::Lower>() * S;
  // I + SᵀNS = U Uᵀ with U upper triangular (Cholesky from the last parameter to the first), so
  // that Σ_u = U⁻ᵀ U⁻¹ and S U⁻ᵀ, lower times lower, is the root.
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

/// What all readings at a pose make of it, with the weights of that pose.
/// @param H_xi, B  work space, as of reading_covariance
inline Outcome fused(const Robot& robot, const Kernels& model, const Knowledge& known,
                     const Pose& pose, double* H_xi, double* B, Fused& fusion) {
  Extended q_e;
  PoseRows H_x;
  ReadingCovariance C;
  Parasitic rest;
  Outcome outcome = model.linearise(robot, pose, q_e, H_x, H_xi, rest);
  if (outcome) outcome = reading_covariance(robot, known, H_xi, B, C);
  if (outcome) outcome = model.fuse(robot, known, C, H_x, fusion);
  return outcome;
}

/// Errors of x̂ at a pose: those that come from ξ, in units of the knowledge's root, and those of
/// the readings themselves.
struct PoseError {
  RowMatrix by_geometry;  ///< n×p
  RowMatrix by_noise;     ///< covariance, n×n
};

inline Outcome pose_error(const Robot& robot, const Kernels& model, const Knowledge& known,
                          const Pose& pose, std::vector<double>& work, PoseError& error) {
  const int n = model.n, rows = n + robot.r, p = known.count;
  work.resize(estimate_work(robot, p));
  double *H_xi = work.data(), *B = H_xi + rows * parameter_count(robot);
  Fused fusion;
  const Outcome outcome = fused(robot, model, known, pose, H_xi, B, fusion);
  if (!outcome) return outcome;
  RowMatrix gain(n, rows);  // of readings in units of their σ
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < rows; ++c) gain(i, c) = fusion.gain[i][c] * known.sigma[c];
  error.by_geometry.noalias() = gain * Eigen::Map<const RowMatrix>(B, rows, p);
  error.by_noise.noalias() = gain * gain.transpose();
  return {};
}

}  // namespace truepose
