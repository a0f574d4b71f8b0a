// Square-root filter on ξ: equations in, one after another.
#include "estimation/root_filter.hpp"

namespace truepose {
namespace {
/// Updates S, or rows that S was multiplied to, by one equation h·δξ = y.
/// @param f           Sᵀh @param alpha  the equation's variance
/// @param M           the rows; `triangular`: S itself
/// @param b           out: each row's product with f; of S the gain times alpha + fᵀf
void update_rows(int p, const Real* f, Real alpha, int rows, bool triangular, Real* M, Real* b) {
  std::fill_n(b, rows, 0);
  for (int j = p - 1; j >= 0; --j) {
    const Real before = alpha;
    alpha += f[j] * f[j];
    const Real beta = sqrt(before / alpha), lambda = f[j] / before;
    for (int i : range(triangular ? j : 0, rows)) {
      const Real old = M[i * p + j];
      M[i * p + j] = beta * (old - lambda * b[i]);
      b[i] += f[j] * old;
    }
  }
}
}  // namespace

void decorrelate(int p, Real* F, Real curvature, Innovations& made) {
  for (int i : range(made.r)) {
    const Real* f = F + i * p;
    const Real open = sum_of(p, [&](int j) { return f[j] * f[j]; });
    const Real curved = curvature * open;
    made.noise[i] = 1 + curved * curved;
    made.total[i] = made.noise[i] + open;
    std::array<Real, kMaxReadings> along;
    const int left = made.r - i - 1;
    update_rows(p, f, made.noise[i], left, false, F + (i + 1) * p, along.data());
    for (int k : range(left)) {
      made.L[i + 1 + k][i] = along[k] / made.total[i];
      made.y[i + 1 + k] -= made.L[i + 1 + k][i] * made.y[i];
    }
  }
}

Outcome innovate(const RootFilter& filter, const Equations& row, Real* F, Innovations& made) {
  const int p = filter.count;
  made.r = row.r;
  copy_first(row.r, row.e, made.y);
  std::copy_n(row.B, row.r * p, F);
  for (int i = 0; i < row.r && row.about != filter.xi; ++i)
    for (int k : range(p)) {
      const int at = filter.column[k];
      made.y[i] -= F[i * p + k] * (filter.xi[at] - row.about[at]);
    }
  times_root({p, filter.column, filter.root, {}}, made.r, F);
  // Linearising about a poor ξ̂ leaves a remainder of second order, the square of the loop
  // residual. It counts as noise, so that the first rows do not overstate their information.
  decorrelate(p, F, row.curvature, made);
  // The update must not overflow, nor an equation be as good as certain. A NaN shows in the sum.
  Real sum = 0 * made.chi2();
  for (int i : range(made.r)) {
    sum += 0 / made.noise[i] + 0 * made.total[i];
    for (int k : range(p)) sum += 0 * (F[i * p + k] / made.noise[i]);
  }
  return {isfinite(sum) ? Status::ok : Status::not_finite};
}

void update(const Innovations& made, const Real* F, RootFilter& filter, Real* gain) {
  const int p = filter.count;
  for (int i = 0; i < made.r; ++i, F += p, gain += p) {
    update_rows(p, F, made.noise[i], p, true, filter.root, gain);
    const Real step = made.y[i] / made.total[i];
    for (int k : range(p)) filter.xi[filter.column[k]] += gain[k] * step;
  }
}

void add_drift(int p, Real* S, Real* v) {
  for (int k : range(p)) {
    const Real length = sqrt(S[k * p + k] * S[k * p + k] + v[k] * v[k]);
    if (!(length > 0)) continue;
    const Real c = S[k * p + k] / length, s = v[k] / length;
    for (int i : range(k, p)) {
      const Real old = S[i * p + k];
      S[i * p + k] = c * old + s * v[i];
      v[i] = c * v[i] - s * old;
    }
  }
}
}  // namespace truepose
