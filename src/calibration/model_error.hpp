// Errors that the ideal level omits, and their size.
#pragma once

#include "calibration/dense.hpp"
#include "estimation/knowledge.hpp"
#include "estimation/linearise.hpp"

namespace truepose {
/// Computes D of the model error of the ideal level. Axes that deviate from nominal tilt the
/// platform and turn its bars; readings then differ by D η to first order, with
/// D = H_ξ(full) - H_ξ(ideal). η, the axis errors, are nuisance parameters.
/// @param known  columns of H_ξ of η; σ of the readings
/// @param H_xi   work space, 2 (n + r) × parameter_count doubles
/// @param D      out: (n + r) × known.count, in units of the readings' σ
Outcome left_out(const Robot& robot, const Knowledge& known, const Pose& pose, double* H_xi,
                 RowMatrix& D);
}  // namespace truepose
