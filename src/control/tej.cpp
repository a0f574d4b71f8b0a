// The extended-to-joint matrix (TEJ), which corrects motor errors by redundant readings.
#include "control/tej.hpp"

namespace truepose {
void tej(const Robot& robot, const Jacobians& jacobians, const SensorRows& jr, ExtendedColumns& M,
         ExtendedRows& M_plus) {
  const int n = dof(robot.mobility), m = robot.motors;
  for (int j = 0; j < m; ++j) {
    Joint column{};
    if (m > n) {
      Coordinates rate;
      for (int i = 0; i < n; ++i) rate[i] = jacobians.J[i][j];
      column = jacobians.joint_rate(rate);
    } else {
      column[j] = 1;
    }
    for (int i = 0; i < m; ++i) M[i][j] = M_plus[i][j] = column[i];
  }
  for (int s = 0; s < robot.r; ++s) {
    const Real weight = robot.sensor[s].weight;
    Joint g, gain;
    for (int j = 0; j < m; ++j)
      M[m + s][j] = g[j] = sum_of(n, [&](int i) { return jr[s][i] * jacobians.J[i][j]; });
    for (int i = 0; i < m; ++i) gain[i] = sum_of(m, [&](int j) { return M_plus[i][j] * g[j]; });
    const Real gCg = sum_of(m, [&](int i) { return g[i] * gain[i]; });
    const Real scale = weight / (1 + weight * gCg);
    for (int i = 0; i < m; ++i) gain[i] *= scale;
    for (int c = 0; c < m + s; ++c) {
      const Real seen = sum_of(m, [&](int i) { return g[i] * M_plus[i][c]; });  // g M⁺, entry c
      for (int i = 0; i < m; ++i) M_plus[i][c] -= gain[i] * seen;
    }
    for (int i = 0; i < m; ++i) M_plus[i][m + s] = gain[i];
  }
}
}  // namespace truepose
