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
      const int width = std::min(kBlock, p - first);
      Real sum[kBlock] = {};
      if (from < first + width) {  // the triangle on the diagonal
        const Real* S = known.root + first * p + first;
        for (int k = 0; k < width; ++k, S += p)
          for (int j = 0; j <= k; ++j) sum[j] += row[first + k] * S[j];
      }
      const int behind = std::max(first + kBlock, from);
      const Real* S = known.root + behind * p + first;
      for (int k = behind; k < to; ++k, S += p)
#pragma GCC unroll 8  // the sums stay in registers: a third fewer instructions
        for (int j = 0; j < kBlock; ++j) sum[j] += row[k] * S[j];
      std::copy_n(sum, width, row + first);
    }
  }
}

void update_root(int p, Real* S, const Real* f, Real alpha, Real* b) {
  for (int j = 0; j < p; ++j) b[j] = 0;
  for (int j = p - 1; j >= 0; --j) {
    const Real before = alpha;
    alpha += f[j] * f[j];
    const Real beta = std::sqrt(before / alpha), lambda = f[j] / before;
    for (int i = j; i < p; ++i) {
      const Real old = S[i * p + j];
      S[i * p + j] = beta * (old - lambda * b[i]);
      b[i] += f[j] * old;
    }
  }
}

void add_drift(int p, Real* S, Real* v) {
  for (int k = 0; k < p; ++k) {
    const Real length = std::sqrt(S[k * p + k] * S[k * p + k] + v[k] * v[k]);
    if (!(length > 0)) continue;
    const Real c = S[k * p + k] / length, s = v[k] / length;
    for (int i = k; i < p; ++i) {
      const Real old = S[i * p + k];
      S[i * p + k] = c * old + s * v[i];
      v[i] = c * v[i] - s * old;
    }
  }
}
}  // namespace truepose
