// Residual tests of one row of readings: contradiction, its isolation, its duration.
#include "estimation/residual_test.hpp"

namespace truepose {
void decorrelate(int p, Real* F, Real curvature, Innovations& line) {
  for (int i = 0; i < line.r; ++i) {
    const Real* f = F + i * p;
    const Real open = sum_of(p, [&](int j) { return f[j] * f[j]; });
    const Real curved = curvature * open;
    line.noise[i] = 1 + curved * curved;
    line.total[i] = line.noise[i] + open;
    for (int k = i + 1; k < line.r; ++k) {
      Real *other = F + k * p, sum = 0, before = line.noise[i];
      for (int j = p - 1; j >= 0; --j) {
        const Real alpha = before + f[j] * f[j], old = other[j];
        other[j] = std::sqrt(before / alpha) * (old - f[j] / before * sum);
        sum += f[j] * old;
        before = alpha;
      }
      line.L[k][i] = sum / line.total[i];
      line.y[k] -= line.L[k][i] * line.y[i];
    }
  }
}

bool of_readings(int n, int rows, RowsOfPose& A, Real* G) {
  std::array<Real, kMaxRows> none{};
  std::fill_n(G, rows * rows, 0.0);
  for (int c = 0; c < rows; ++c) G[c * rows + c] = 1;
  return eliminate(n, rows, A, G, rows, none);
}

bool explained(int n, RowsOfPose& A, const Innovations& line, Extended& by) {
  const int rows = n + line.r;
  std::array<Real, kMaxRows * kMaxRows> unit;
  if (!of_readings(n, rows, A, unit.data())) return false;
  for (int c = 0; c < rows; ++c) {
    Real score = 0, information = 0;
    std::array<Real, kMaxReadings> g;
    for (int i = 0; i < line.r; ++i) {
      g[i] = unit[(n + i) * rows + c];
      for (int k = 0; k < i; ++k) g[i] -= line.L[i][k] * g[k];
      score += g[i] * line.y[i] / line.total[i];
      information += g[i] * g[i] / line.total[i];
    }
    by[c] = information > kSingular ? score * score / information : 0;
  }
  return true;
}

int outstanding(int count, const Extended& value, Real margin) {
  const auto end = value.begin() + count;
  const auto most = std::max_element(value.begin(), end);
  for (auto other = value.begin(); other != end; ++other)
    if (other != most && *other > *most - margin) return -1;
  return static_cast<int>(most - value.begin());
}
}  // namespace truepose
