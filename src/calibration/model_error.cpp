// Errors that the ideal level omits, and their size.
#include "calibration/model_error.hpp"

namespace truepose {
Outcome left_out(const Robot& robot, const Knowledge& known, const Pose& pose, double* H_xi,
                 RowMatrix& D) {
  const int rows = readings(robot), size = rows * parameter_count(robot);
  Extended q_e;
  PoseRows H_x;
  Outcome outcome = linearise(Level::full, robot, pose, q_e, H_x, H_xi);
  if (outcome) outcome = linearise(Level::ideal, robot, pose, q_e, H_x, H_xi + size);
  if (!outcome) return outcome;
  for (int k : range(size)) H_xi[k] -= H_xi[size + k];
  D = RowMatrix(rows, known.count);
  gather(robot, known, H_xi, rows, D.data());
  return outcome;
}
}  // namespace truepose
