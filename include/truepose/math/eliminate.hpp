// Elimination of the pose from the readings' linear model, which leaves rows in ξ alone.
//
// To first order e = H_x δx + H_ξ δξ + noise. In units of the readings' σ, Householder reflections
// turn H_x into [R; 0]: the n upper rows give δx once δξ is known. The others contain no δx and
// hold all the information on ξ, so a pose costs only its own n rows (Schur complement).
#pragma once

#include "truepose/math/ldlt.hpp"
#include "truepose/model/pose.hpp"

namespace truepose {
inline constexpr int kMaxRows = kMaxReadings + kMaxDof;  ///< readings and an external measurement
using RowsOfPose = Matrix<kMaxRows, kMaxDof>;            ///< H_x in the first n columns

/// Eliminates the pose from whitened rows.
/// @param rows  number of rows of A, B and e, at least n, the degrees of freedom
/// @param A     in: H_x; out: R in its upper triangle
/// @param B     in: H_ξ, rows of `width`; out: n rows beside R, the others free of δx
/// @param e     in: measured minus expected; out: in the rows of B
/// @return false where the rows do not determine the pose
inline bool eliminate(int n, int rows, RowsOfPose& A, Real* B, int width,
                      std::array<Real, kMaxRows>& e) {
  constexpr int kBlock = 16;
  for (int j = 0; j < n; ++j) {
    Real norm2 = 0, whole2 = 0;
    for (int i = 0; i < rows; ++i) (i < j ? whole2 : norm2) += A[i][j] * A[i][j];
    whole2 += norm2;
    if (!(norm2 > kSingular * whole2)) return false;  // also for a NaN
    // v = a + sign(a_j) |a| e_j, H = I - 2 v vᵀ / vᵀv
    const Real norm = std::copysign(std::sqrt(norm2), A[j][j]);
    std::array<Real, kMaxRows> v;
    for (int i = j; i < rows; ++i) v[i] = A[i][j];
    v[j] += norm;
    const Real scale = 1 / (norm * v[j]);  // 2 / vᵀv
    const auto reflect = [&](Real* column, int stride) {
      Real dot = 0;
      for (int i = j; i < rows; ++i) dot += v[i] * column[i * stride];
      dot *= scale;
      for (int i = j; i < rows; ++i) column[i * stride] -= dot * v[i];
    };
    for (int k = j; k < n; ++k) reflect(&A[0][k], kMaxDof);
    reflect(e.data(), 1);
    for (int first = 0; first < width; first += kBlock) {  // along the rows of B, in blocks
      const int count = std::min(kBlock, width - first);
      Real dot[kBlock] = {};
      for (int i = j; i < rows; ++i)
        for (int k = 0; k < count; ++k) dot[k] += v[i] * B[i * width + first + k];
      for (int i = j; i < rows; ++i)
        for (int k = 0; k < count; ++k) B[i * width + first + k] -= scale * dot[k] * v[i];
    }
  }
  return true;
}

/// Solves R x = b in place, with R from `eliminate`.
inline void back_substitute(int n, const RowsOfPose& R, Coordinates& b) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) b[i] -= R[i][k] * b[k];
    b[i] /= R[i][i];
  }
}
}  // namespace truepose
