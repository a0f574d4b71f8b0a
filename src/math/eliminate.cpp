// Elimination of the pose from the readings' linear model, which leaves rows in ξ alone.
#include "math/eliminate.hpp"

namespace truepose {
bool eliminate(int n, int rows, RowsOfPose& A, Real* B, int width, std::array<Real, kMaxRows>& e) {
  constexpr int kBlock = 16;
  for (int j : range(n)) {
    Real norm2 = 0, whole2 = 0;
    for (int i : range(rows)) (i < j ? whole2 : norm2) += A[i][j] * A[i][j];
    whole2 += norm2;
    if (!(norm2 > kSingular * whole2)) return false;  // also for a NaN
    // v = a + sign(a_j) |a| e_j, H = I - 2 v vᵀ / vᵀv
    const Real norm = copysign(sqrt(norm2), A[j][j]);
    std::array<Real, kMaxRows> v;
    for (int i : range(j, rows)) v[i] = A[i][j];
    v[j] += norm;
    const Real scale = 1 / (norm * v[j]);                             // 2 / vᵀv
    const auto reflect = [&](Real* columns, int count, int stride) {  // along the rows, in blocks
      for (int first = 0; first < count; first += kBlock) {
        const int last = min(first + kBlock, count);
        Real dot[kBlock] = {};
        for (int i : range(j, rows))
          for (int k : range(first, last)) dot[k - first] += v[i] * columns[i * stride + k];
        for (int i : range(j, rows))
          for (int k : range(first, last)) columns[i * stride + k] -= scale * dot[k - first] * v[i];
      }
    };
    reflect(&A[0][j], n - j, kMaxDof);
    reflect(e.data(), 1, 1);
    reflect(B, width, width);
  }
  return true;
}

void back_substitute(int n, const RowsOfPose& R, Coordinates& b) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k : range(i + 1, n)) b[i] -= R[i][k] * b[k];
    b[i] /= R[i][i];
  }
}
}  // namespace truepose
