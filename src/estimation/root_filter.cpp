// Square-root filter on ξ: equations in, one after another.
#include "estimation/root_filter.hpp"

namespace truepose {
void decorrelate(int p, Real* F, Real curvature, Innovations& made) {
  for (int i : range(made.r)) {
    const Real* f = F + i * p;
    const Real open = sum_of(p, [&](int j) { return f[j] * f[j]; });
    const Real curved = curvature * open;
    made.noise[i] = 1 + curved * curved;
    made.total[i] = made.noise[i] + open;
    for (int k : range(i + 1, made.r)) {
      Real *other = F + k * p, sum = 0, before = made.noise[i];
      for (int j = p - 1; j >= 0; --j) {
        const Real alpha = before + f[j] * f[j], old = other[j];
        other[j] = sqrt(before / alpha) * (old - f[j] / before * sum);
        sum += f[j] * old;
        before = alpha;
      }
      made.L[k][i] = sum / made.total[i];
      made.y[k] -= made.L[k][i] * made.y[i];
    }
  }
}

Outcome innovate(const RootFilter& filter, const Real* about, Real curvature, Real* F,
                 Innovations& made) {
  const int p = filter.count;
  for (int i = 0; i < made.r && about != filter.xi; ++i)
    for (int k : range(p)) {
      const int at = filter.column[k];
      made.y[i] -= F[i * p + k] * (filter.xi[at] - about[at]);
    }
  times_root({p, filter.column, filter.root, {}}, made.r, F);
  // Linearising about a poor ξ̂ leaves a remainder of second order, the square of the loop
  // residual. It counts as noise, so that the first rows do not overstate their information.
  decorrelate(p, F, curvature, made);
  // The update must not overflow, nor an equation be as good as certain. A NaN shows in the sum.
  Real sum = 0 * made.chi2();
  for (int i : range(made.r)) {
    sum += 0 / made.noise[i] + 0 * made.total[i];
    for (int k : range(p)) sum += 0 * (F[i * p + k] / made.noise[i]);
  }
  return {isfinite(sum) ? Status::ok : Status::not_finite};
}

namespace {
/// Updates S by one equation h·δξ = y. @param alpha  its variance @param f  Sᵀh
/// @param b  out: the gain times alpha + fᵀf
void update_root(int p, Real* S, const Real* f, Real alpha, Real* b) {
  for (int j : range(p)) b[j] = 0;
  for (int j = p - 1; j >= 0; --j) {
    const Real before = alpha;
    alpha += f[j] * f[j];
    const Real beta = sqrt(before / alpha), lambda = f[j] / before;
    for (int i : range(j, p)) {
      const Real old = S[i * p + j];
      S[i * p + j] = beta * (old - lambda * b[i]);
      b[i] += f[j] * old;
    }
  }
}
}  // namespace

void update(const Innovations& made, const Real* F, RootFilter& filter, Real* gain) {
  const int p = filter.count;
  for (int i = 0; i < made.r; ++i, F += p, gain += p) {
    update_root(p, filter.root, F, made.noise[i], gain);
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
