// Covariances of the geometry and of the readings: Σ_ξ and Σ_s.
#include "estimation/knowledge.hpp"

namespace truepose {
void times_root(const Knowledge& known, int rows, Real* B) {
  constexpr int kBlock = 8;
  const int p = known.root ? known.count : 0;
  for (Real* row = B; row != B + rows * p; row += p) {
    int from = 0, to = p;  // the entries that are not zero
    while (to > 0 && row[to - 1] == 0) --to;
    while (from < to && row[from] == 0) ++from;
    for (int first = 0; first < to; first += kBlock) {
      const int width = min(kBlock, p - first);
      Real sum[kBlock] = {};
      if (from < first + width) {  // the triangle on the diagonal
        const Real* S = known.root + first * p + first;
        for (int k = 0; k < width; ++k, S += p)
          for (int j : range(k + 1)) sum[j] += row[first + k] * S[j];
      }
      const int behind = max(first + kBlock, from);
      const Real* S = known.root + behind * p + first;
      for (int k = behind; k < to; ++k, S += p)
#pragma GCC unroll 8  // the sums stay in registers: a third fewer instructions
        for (int j : range(kBlock)) sum[j] += row[k] * S[j];
      std::copy_n(sum, width, row + first);
    }
  }
}
}  // namespace truepose
