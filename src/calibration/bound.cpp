// The (Bayesian, linear-Gaussian) Cramér-Rao bound of the pose.
#include "calibration/bound.hpp"

namespace truepose {
Outcome rows_of_visits(Level level, const Robot& robot, const Knowledge& prior, int nuisances,
                       const std::vector<Visit>& visits, const Links& links, VisitRows& all,
                       const std::function<void()>& poll) {
  if (!robot.finished) return {Status::unfinished};
  Knowledge raw = prior;
  raw.root = nullptr;
  Knowledge axes = raw;
  axes.count = nuisances;
  axes.column += prior.count - nuisances;
  RowMatrix D;
  std::vector<double> H_xi(2 * readings(robot) * parameter_count(robot));
  std::vector<Pose> poses;
  std::vector<Line> lines;
  Parasitic rest;
  for (const Visit& visit : visits) {
    Outcome outcome = acting(robot, axes, visit.pose, visit.influences, H_xi.data(), D);
    if (outcome)
      outcome = linearise_line(level, robot, raw, visit.pose, nullptr, visit.outside, D,
                               H_xi.data(), lines.emplace_back(), rest);
    if (!outcome) return outcome;
    poses.push_back(visit.pose);
    poll();
  }
  const std::vector<LinkBlock> blocks =
      linked(robot.mobility, links, links.mean.data(), raw, poses, lines);
  all.B = RowMatrix(equation_count(lines, blocks), prior.count);
  all.visit.clear();
  each_equation(lines, blocks, [&](const double* B, double, int line, bool) {
    std::copy_n(B, prior.count, all.B[int(all.visit.size())]);
    all.visit.push_back(line);
  });
  return {};
}

Outcome fused(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
              const Influences& acting, double* H_xi, double* B, Fused& fusion) {
  Extended q_e;
  PoseRows H_x;
  ReadingCovariance C;
  Parasitic rest;
  Outcome outcome = linearise(level, robot, pose, q_e, H_x, H_xi, &rest);
  if (!outcome) return outcome;
  const int rows = readings(robot), m = acting.count, p = known.count;
  for (int c : range(rows))
    for (int j : range(m)) B[(c + 1) * p - m + j] = acting.pattern[c * m + j] / known.sigma[c];
  outcome = reading_covariance(robot, known, H_xi, B, C);
  if (outcome) outcome = fuse(robot, known, C, H_x, fusion);
  if (outcome) weighted_tej(robot, H_x, fusion, fusion.tej);
  return outcome;
}

Outcome pose_error(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                   const Influences& acting, std::vector<double>& work, PoseError& error) {
  const int n = dof(robot.mobility), rows = readings(robot), p = known.count;
  work.resize(estimate_work(robot, p));
  double *H_xi = work.data(), *B = H_xi + rows * parameter_count(robot);
  Fused fusion;
  const Outcome outcome = fused(level, robot, known, pose, acting, H_xi, B, fusion);
  if (!outcome) return outcome;
  RowMatrix gain(n, rows);  // of readings in units of their σ
  for (int i : range(n))
    for (int c : range(rows)) gain(i, c) = fusion.gain[i][c] * known.sigma[c];
  error.by_geometry = gain * RowMatrix(rows, p, B);
  error.by_noise = gain * transposed(gain);
  return {};
}
}  // namespace truepose
