// Inverse of the 6×6 matrix of a spatial robot, by two triples of its rows.
#pragma once

#include "truepose/math/adjugate.hpp"
#include "truepose/math/lanes.hpp"

namespace truepose {
using PairBlock = std::array<std::array<Pair, 3>, 3>;

/// Computes A B, lane by lane.
inline void multiply(const PairBlock& a, const PairBlock& b, PairBlock& product) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      product[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/// Below this the determinant of three rods' directions, in units of their mean square, is too
/// small to divide by: a block then loses at most four of sixteen digits.
inline constexpr Real kIndependent = 1e-2;

/// Inverse and determinant of a 6×6 matrix whose even rows are [P Q] and whose odd rows are [S T]:
///
///     [P Q; S T] = diag(P, S) [I B₁; I B₂],   B₁ = P⁻¹Q,  B₂ = S⁻¹T,  G = B₂ - B₁
///     [P Q; S T]⁻¹ = [-B₂W₁ -B₁W₂; W₁ W₂],    W₁ = -G⁻¹P⁻¹,  W₂ = G⁻¹S⁻¹
///
/// P and S hold the rods' v, of mean square `size`. Each column of the inverse is multiplied by its
/// `scale`. The first lane holds P, Q and -G, the second S, T and G: every product serves both.
struct Triples {
  bool independent = false;  ///< P and S are far from singular; else nothing was computed
  Real determinant = 0;
  Real difference = 0;  ///< det G: the matrix is singular where this vanishes
};
inline Triples invert_by_triples(const std::array<Lanes<6>, 6>& columns, Real size,
                                 const Lanes<6>& scale, Matrix<6, 6>& inverse) {
  PairBlock V, M;
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) {
      V[k][j] = columns[j].segment<2>(2 * k);
      M[k][j] = columns[3 + j].segment<2>(2 * k);
    }
  PairBlock V_adjugate, B, difference, D_adjugate, W, top;
  const Pair det_V = adjugate<3>(V, V_adjugate);
  const Real least2 = kIndependent * kIndependent * size * size * size;
  if (!(det_V[0] * det_V[0] > least2 && det_V[1] * det_V[1] > least2)) return {};

  const Pair minus_per_det = -1 / det_V;
  multiply(V_adjugate, M, B);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const Pair minus_B = minus_per_det * B[i][j];
      B[i][j] = swapped(minus_B);  // swapped for the other lane: [-B₂, -B₁]
      difference[i][j] = B[i][j] - minus_B;
    }
  const Pair det_D = adjugate<3>(difference, D_adjugate);
  const Pair per_det = 1 / (det_D * det_V);
  multiply(D_adjugate, V_adjugate, W);
  for (int k = 0; k < 3; ++k) {
    const Pair factor = per_det * scale.segment<2>(2 * k);
    for (int i = 0; i < 3; ++i) W[i][k] *= factor;
  }
  multiply(B, W, top);
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) {
      Eigen::Map<Pair>(inverse[i].data() + 2 * k) = top[i][k];
      Eigen::Map<Pair>(inverse[3 + i].data() + 2 * k) = W[i][k];
    }
  return {true, -det_V[0] * det_V[1] * det_D[1], det_D[1]};  // rows 0 2 4 1 3 5: an odd permutation
}
}  // namespace truepose
