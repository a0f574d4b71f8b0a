// Elimination of the pose from the readings' linear model, which leaves rows in ξ alone.
//
// To first order e = H_x δx + H_ξ δξ + noise. In units of the readings' σ, Householder reflections
// turn H_x into [R; 0]: the n upper rows give δx once δξ is known. The others contain no δx and
// hold all the information on ξ, so a pose costs only its own n rows (Schur complement).
#pragma once

#include "math/ldlt.hpp"
#include "mechanism/pose.hpp"

namespace truepose {
inline constexpr int kMaxRows = kMaxReadings + kMaxDof;  ///< readings and an external measurement
using RowsOfPose = Matrix<kMaxRows, kMaxDof>;            ///< H_x in the first n columns

/// Eliminates the pose from whitened rows.
/// @param rows  number of rows of A, B and e, at least n, the degrees of freedom
/// @param A     in: H_x; out: R in its upper triangle
/// @param B     in: H_ξ, rows of `width`; out: n rows beside R, the others free of δx
/// @param e     in: measured minus expected; out: in the rows of B
/// @return false where the rows do not determine the pose
bool eliminate(int n, int rows, RowsOfPose& A, Real* B, int width, std::array<Real, kMaxRows>& e);

/// Solves R x = b in place, with R from `eliminate`.
void back_substitute(int n, const RowsOfPose& R, Coordinates& b);
}  // namespace truepose
