// The extended-to-joint matrix (TEJ), which corrects motor errors by redundant readings.
#include "control/tej.hpp"

namespace truepose {
void tej(const Robot& robot, const Jacobians& jacobians, const SensorRows& jr, ExtendedColumns& M,
         ExtendedRows& M_plus) {
  const int n = dof(robot.mobility);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) M[i][j] = M_plus[i][j] = i == j;
  for (int s = 0; s < robot.r; ++s) {
    const Real weight = robot.sensor[s].weight;
    Coordinates g, gain;
    for (int j = 0; j < n; ++j)
      M[n + s][j] = g[j] = sum_of(n, [&](int i) { return jr[s][i] * jacobians.J[i][j]; });
    for (int i = 0; i < n; ++i) gain[i] = sum_of(n, [&](int j) { return M_plus[i][j] * g[j]; });
    const Real gCg = sum_of(n, [&](int i) { return g[i] * gain[i]; });
    const Real scale = weight / (1 + weight * gCg);
    for (int i = 0; i < n; ++i) gain[i] *= scale;
    for (int c = 0; c < n + s; ++c) {
      const Real seen = sum_of(n, [&](int i) { return g[i] * M_plus[i][c]; });  // g M⁺, entry c
      for (int i = 0; i < n; ++i) M_plus[i][c] -= gain[i] * seen;
    }
    for (int i = 0; i < n; ++i) M_plus[i][n + s] = gain[i];
  }
}
}  // namespace truepose
