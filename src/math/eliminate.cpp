// Elimination of the pose from the readings' linear model, which leaves rows in ξ alone.
#include "math/eliminate.hpp"

namespace truepose {
bool eliminate(int n, int rows, RowsOfPose& A, Real* B, int width, std::array<Real, kMaxRows>& e) {
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

void back_substitute(int n, const RowsOfPose& R, Coordinates& b) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) b[i] -= R[i][k] * b[k];
    b[i] /= R[i][i];
  }
}
}  // namespace truepose
