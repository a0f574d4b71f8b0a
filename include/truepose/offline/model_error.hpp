// Errors that the ideal level omits, and their size.
#pragma once

#include "truepose/estimation/knowledge.hpp"
#include "truepose/full/linearise.hpp"
#include "truepose/math/dense.hpp"

namespace truepose {
/// Computes D of the model error of the ideal level. Axes that deviate from nominal tilt the
/// platform and turn its bars; readings then differ by D η to first order, with
/// D = H_ξ(full) - H_ξ(ideal). η, the axis errors, are nuisance parameters.
/// @param known  columns of H_ξ of η; σ of the readings
/// @param H_xi   work space, 2 (n + r) × parameter_count doubles
/// @param D      out: (n + r) × known.count, in units of the readings' σ
inline Outcome left_out(const Robot& robot, const Knowledge& known, const Pose& pose, double* H_xi,
                 RowMatrix& D) {
  const int rows = dof(robot.mobility) + robot.r, size = rows * parameter_count(robot);
  Extended q_e;
  PoseRows H_x;
  Outcome outcome = linearise_full(robot, pose, q_e, H_x, H_xi);
  if (outcome) outcome = linearise(robot, pose, q_e, H_x, H_xi + size);
  if (!outcome) return outcome;
  for (int k = 0; k < size; ++k) H_xi[k] -= H_xi[size + k];
  D.resize(rows, known.count);
  gather(robot, known, H_xi, rows, D.data());
  return outcome;
}
}  // namespace truepose
