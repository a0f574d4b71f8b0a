// The (Bayesian, linear-Gaussian) Cramér-Rao bound of the pose.
#include "calibration/bound.hpp"

namespace truepose {
Outcome rows_of_visits(Level level, const Robot& robot, const Knowledge& prior, int nuisances,
                       const std::vector<Visit>& visits, const Links& links, VisitRows& all,
                       const std::function<void()>& poll) {
  if (!robot.finished) return {Status::unfinished};
  const int n = dof(robot.mobility), p = prior.count;
  Knowledge raw = prior;
  raw.root = nullptr;
  Knowledge axes = raw;
  axes.count = nuisances;
  axes.column += p - nuisances;
  RowMatrix D;
  std::vector<double> H_xi(2 * readings(robot) * parameter_count(robot));
  int rows = int(links.link.size());
  for (const Visit& visit : visits) rows += redundancy(robot) + (visit.outside.x ? n : 0);
  all.B = RowMatrix(rows, p);
  all.visit.clear();
  std::vector<Pose> poses;
  std::vector<Line> lines;  // only where there are links
  Line line;
  Parasitic rest;
  int row = 0;
  for (const Visit& visit : visits) {
    Outcome outcome = acting(robot, axes, visit.pose, visit.influences, H_xi.data(), D);
    if (outcome)
      outcome = linearise_line(level, robot, raw, visit.pose, nullptr, visit.outside,
                               D.cols() > 0 ? &D : nullptr, H_xi.data(), line, rest);
    if (!outcome) return outcome;
    std::copy(line.B[n], line.B[line.rows], all.B[row]);
    row += line.redundancy();
    all.visit.insert(all.visit.end(), line.redundancy(), int(&visit - visits.data()));
    if (!links.link.empty()) {
      poses.push_back(visit.pose);
      lines.push_back(line);
    }
    poll();
  }
  if (!links.link.empty())
    for (LinkBlock& block : linked(robot.mobility, links, links.mean.data(), raw, poses, lines)) {
      solve_lower(block.C, block.B);
      std::ranges::copy(block.B, all.B[row]);
      all.visit.insert(all.visit.end(), block.size(), links.link[block.link[0]].line[0]);
      row += block.size();
    }
  all.B.keep(row);
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
  gather(robot, known, H_xi, rows, B, m);
  for (int c : range(rows))
    for (int j : range(m)) B[(c + 1) * p - m + j] = acting.pattern[c * m + j] / known.sigma[c];
  outcome = reading_covariance(robot, known, B, C);
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
