#include "calibration/bound.hpp"

namespace truepose {
Outcome fused(const Robot& robot, const Kernels& model, const Knowledge& known, const Pose& pose,
              const Influences& acting, double* H_xi, double* B, Fused& fusion) {
  Extended q_e;
  PoseRows H_x;
  ReadingCovariance C;
  Parasitic rest;
  Outcome outcome = model.linearise(robot, pose, q_e, H_x, H_xi, rest);
  if (!outcome) return outcome;
  const int rows = model.n + robot.r, m = acting.count, p = known.count;
  gather(robot, known, H_xi, rows, B, m);
  for (int c = 0; c < rows; ++c)
    for (int j = 0; j < m; ++j) B[(c + 1) * p - m + j] = acting.pattern[c * m + j] / known.sigma[c];
  outcome = reading_covariance(robot, known, B, C);
  if (outcome) outcome = model.fuse(robot, known, C, H_x, fusion);
  return outcome;
}

Outcome pose_error(const Robot& robot, const Kernels& model, const Knowledge& known,
                   const Pose& pose, const Influences& acting, std::vector<double>& work,
                   PoseError& error) {
  const int n = model.n, rows = n + robot.r, p = known.count;
  work.resize(estimate_work(robot, p));
  double *H_xi = work.data(), *B = H_xi + rows * parameter_count(robot);
  Fused fusion;
  const Outcome outcome = fused(robot, model, known, pose, acting, H_xi, B, fusion);
  if (!outcome) return outcome;
  RowMatrix gain(n, rows);  // of readings in units of their σ
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < rows; ++c) gain(i, c) = fusion.gain[i][c] * known.sigma[c];
  error.by_geometry.noalias() = gain * Eigen::Map<const RowMatrix>(B, rows, p);
  error.by_noise.noalias() = gain * gain.transpose();
  return {};
}
}  // namespace truepose
