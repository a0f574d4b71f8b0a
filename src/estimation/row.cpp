// One row of readings as whitened equations, from which the pose can be eliminated.
#include "estimation/row.hpp"

namespace truepose {
Outcome linearise_row(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                      const Real* q_e, Real* H_xi, Real* B, ReadingRow& row, Parasitic& rest) {
  Extended expected;
  PoseRows H_x;
  const Outcome outcome = linearise(level, robot, pose, expected, H_x, H_xi, &rest);
  const int count = gathered(known);
  row.n = dof(robot.mobility), row.rows = 0;
  for (int c = 0; c < readings(robot) && outcome; ++c) {
    const Real e = q_e ? within_turn(robot, c, q_e[c] - expected[c]) : 0;
    if (!isfinite(e)) continue;
    const Real weight = 1 / known.sigma[c];
    if (H_xi) gather_row(robot, known, count, H_xi, c, B + row.rows * known.count);
    for (int j : range(row.n)) row.R[row.rows][j] = H_x[c][j] * weight;
    row.e[row.rows] = e * weight;
    row.reading[row.rows++] = c;
  }
  return outcome;
}

bool of_readings(int n, int rows, RowsOfPose A, Real* G) {
  std::array<Real, kMaxRows> none{};
  std::fill_n(G, rows * rows, 0.0);
  for (int c : range(rows)) G[c * rows + c] = 1;
  return eliminate(n, rows, A, G, rows, none);
}
}  // namespace truepose
