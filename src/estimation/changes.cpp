// Changes of a robot in its life: which of them the rows of a window show.
#include "estimation/changes.hpp"

#include <utility>

namespace truepose {
namespace {
constexpr int kFaults = 2;  ///< steps of a reading's fault: bias, drift

int responses(const ChangeSettings& changes, int readings) {
  return changes.count + kFaults * readings;
}

/// Steps of a change; after those of the settings, of a reading's fault.
struct Steps {
  int first, count;
};
Steps steps_of(const ChangeSettings& changes, int change) {
  const int fault = change - changes.sets;
  if (fault >= 0) return {changes.count + kFaults * fault, kFaults};
  const int first = change > 0 ? changes.end[change - 1] : 0;
  return {first, changes.end[change] - first};
}

int widest(const ChangeSettings& changes) {
  int most = kFaults;
  for (int k = 0; k < changes.sets; ++k) most = std::max(most, steps_of(changes, k).count);
  return most;
}

/// Log of the marginal likelihood over that of no change, and by how much χ² is lower.
struct Gain {
  Real log_odds, chi2;
};
Gain gain_of(const Steps& steps, const Window& window) {
  const int n = steps.count;
  Real *L = window.scratch, *y = L + n * n;
  Gain gain{};
  for (int i = 0; i < n; ++i) {  // Cholesky and forward substitution, row by row
    const Real* row = window.product + (steps.first + i) * window.widest;
    y[i] = window.z[steps.first + i];
    for (int j = 0; j <= i; ++j) {
      Real sum = row[j] + (i == j);
      for (int k = 0; k < j; ++k) sum -= L[i * n + k] * L[j * n + k];
      L[i * n + j] = i == j ? std::sqrt(std::max(sum, Real(1))) : sum / L[j * n + j];
    }
    for (int k = 0; k < i; ++k) y[i] -= L[i * n + k] * y[k];
    y[i] /= L[i * n + i];
    gain.chi2 += y[i] * y[i];
    gain.log_odds -= std::log(L[i * n + i]);
  }
  gain.log_odds += gain.chi2 / 2;
  return gain;
}
}  // namespace

int window_memory(const Robot& robot, int p, const ChangeSettings& changes) {
  if (changes.sets == 0) return 0;
  const int m = readings(robot), K = responses(changes, m), n = widest(changes);
  return 2 * p * (p + 1) + K * (p + 1 + n + redundancy(robot)) + n * (n + 1) + changes.count +
         kStored * m + parameter_count(robot);
}

void lay_out(const Robot& robot, int p, const ChangeSettings& changes, Real* memory,
             Window& window) {
  const int m = readings(robot), K = responses(changes, m), n = widest(changes);
  const auto take = [&](int count) { return std::exchange(memory, memory + count); };
  window.widest = n;
  window.base = take(p * (p + 1)), window.mean = take(p * (p + 1));
  window.response = take(K * p), window.z = take(K), window.product = take(K * n);
  window.share = take(changes.count);
  window.scratch = take(n * (n + 1) + K * redundancy(robot));
  window.stored = take(kStored * m);
  window.about = take(parameter_count(robot));
}

void restart(const ChangeSettings& changes, int readings, int p, Window& window, Real* work) {
  const int K = responses(changes, readings);
  std::copy_n(window.base, p * (p + 1), window.mean);
  if (changes.load >= 0)
    for (int j = 0; j < p; ++j) window.mean[j] += window.moved * changes.step[changes.load * p + j];
  for (int k = 0; k < changes.count; ++k) {
    if (!(window.share[k] > 0)) continue;
    for (int j = 0; j < p; ++j) work[j] = std::sqrt(window.share[k]) * changes.step[k * p + j];
    add_drift(p, window.mean + p, work);
  }
  std::fill_n(window.response, K * p, 0.0);
  std::fill_n(window.z, K, 0.0);
  std::fill_n(window.product, K * window.widest, 0.0);
  window.noisy = {};
  window.rows = window.used = window.freedom = 0;
  window.chi2 = 0;
  window.gross = false;
}

void add_row(const ChangeSettings& changes, const Knowledge& known, const Equations& row,
             Window& window, Real* work) {
  const int p = known.count, r = row.r, readings = row.readings;
  Real *F = work, *gain = F + r * p, *S = window.mean + p;
  Innovations line;
  line.r = r;
  for (int i = 0; i < r; ++i) {
    line.y[i] = row.e[i];
    for (int k = 0; k < p; ++k)
      line.y[i] -= row.B[i * p + k] * (window.mean[k] - row.about[known.column[k]]);
  }
  std::copy_n(row.B, r * p, F);
  times_root({p, known.column, S, known.sigma}, r, F);
  decorrelate(p, F, row.curvature, line);
  const Real chi2 = line.chi2();
  Real sum = 0 * chi2;
  for (int i = 0; i < r; ++i) {
    sum += 0 / line.noise[i];
    for (int k = 0; k < p; ++k) sum += 0 * (F[i * p + k] / line.noise[i]);
  }
  ++window.rows;
  const bool gross = !(chi2 <= beyond(kGate, r));
  // One gross row says nothing of a change; the next ones do.
  if (!std::isfinite(sum) || (gross && !std::exchange(window.gross, gross))) return;
  window.gross = gross;
  window.chi2 += chi2, window.freedom += r, ++window.used;
  for (int i = 0; i < r; ++i) {
    update_root(p, S, F + i * p, line.noise[i], gain + i * p);
    for (int k = 0; k < p; ++k) window.mean[k] += gain[i * p + k] * line.y[i] / line.total[i];
  }
  const auto independent = [&](std::array<Real, kMaxReadings>& w) {
    for (int i = 0; i < r; ++i)
      for (int k = 0; k < i; ++k) w[i] -= line.L[i][k] * w[k];
  };
  std::array<Real, kMaxReadings> w;
  Real* const every = window.scratch;
  const auto respond = [&](int k) {  // w holds the step's own effect
    Real* own = window.response + k * p;
    for (int i = 0; i < r; ++i)
      for (int j = 0; j < p; ++j) w[i] -= row.B[i * p + j] * own[j];
    independent(w);
    for (int i = 0; i < r; ++i) {
      const Real share = w[i] / line.total[i];
      window.z[k] += share * line.y[i];
      every[k * r + i] = w[i];
      for (int j = 0; j < p; ++j) own[j] += gain[i * p + j] * share;
    }
  };
  for (int k = 0; k < changes.count; ++k) {
    for (int i = 0; i < r; ++i) {
      const auto by = [&](int j) { return row.B[i * p + j] * changes.step[k * p + j]; };
      w[i] = k == changes.load && row.loaded ? row.loaded[i] : sum_of(p, by);
    }
    respond(k);
  }
  for (int c = 0; c < readings; ++c) {
    for (int fault = 0; fault < kFaults; ++fault) {
      const Real bias = kFault / known.sigma[c] * (fault ? Real(window.rows) / kWindow : 1);
      for (int i = 0; i < r; ++i) w[i] = bias * row.G[i * readings + c];
      respond(changes.count + kFaults * c + fault);
    }
    for (int i = 0; i < r; ++i) w[i] = row.G[i * readings + c];
    independent(w);
    Real score = 0, information = 0;
    for (int i = 0; i < r; ++i) {
      score += w[i] * line.y[i] / line.total[i];
      information += w[i] * w[i] / line.total[i];
    }
    for (std::size_t f = 0; f < kFactor.size(); ++f) {
      const Real more = kFactor[f] * kFactor[f] - 1, volume = 1 + more * information;
      window.noisy[f][c] += 0.5 * (more * score * score / volume - std::log(volume));
    }
  }
  for (int change = 0; change < changes.sets + readings; ++change) {
    const auto [first, count] = steps_of(changes, change);
    for (int a = first; a < first + count; ++a)
      for (int b = first; b <= a; ++b)
        for (int i = 0; i < r; ++i)
          window.product[a * window.widest + b - first] +=
              every[a * r + i] * every[b * r + i] / line.total[i];
  }
}

Finding decide(const ChangeSettings& changes, int readings, Window& window, Extended& sigma) {
  Finding finding;
  std::array<Recognised, 3> best;  // of each kind
  for (Recognised& of : best) of.log_odds = -INFINITY;
  const auto best_of = [&](ChangeKind kind) -> Recognised& {
    return best[static_cast<std::size_t>(kind)];
  };
  Real left = window.chi2, top = 0;
  const auto compare = [&](ChangeKind kind, int which, const Gain& gain) {
    Recognised& of = best_of(kind);
    if (gain.log_odds > of.log_odds) of = {0, kind, which, gain.log_odds};
    if (!(gain.log_odds > top)) return false;
    top = gain.log_odds, left = window.chi2 - gain.chi2;
    finding.likeliest = of;
    return true;
  };
  const auto gain = [&](int change) {
    Gain found = gain_of(steps_of(changes, change), window);
    found.log_odds += change < changes.sets ? changes.log_odds[change] : kLogFault;
    return found;
  };
  for (int k = 0; k < changes.sets; ++k) compare(ChangeKind::part, k, gain(k));
  for (int c = 0; c < readings; ++c) compare(ChangeKind::fault, c, gain(changes.sets + c));
  const Real steps_top = top;
  Real factor = 1;  // of noise, if that is the likeliest
  for (int c = 0; c < readings; ++c)
    for (std::size_t f = 0; f < kFactor.size(); ++f) {
      if (kFactor[f] < 1 && sigma[c] < 1.5 * window.sigma[c]) continue;
      const bool wild = kFactor[f] * sigma[c] > kNoisiest * window.sigma[c];
      if (compare(wild ? ChangeKind::fault : ChangeKind::noise, c,
                  {window.noisy[f][c] + kLogNoise, window.chi2}))
        factor = kFactor[f];
    }
  const bool noisy = top > steps_top;
  // Relative to the likeliest.
  const Real none = std::exp(-top);
  Real parts = 0, faults = 0;
  for (int k = 0; k < changes.sets; ++k) parts += std::exp(gain(k).log_odds - top);
  for (int c = 0; c < readings; ++c) faults += std::exp(gain(changes.sets + c).log_odds - top);
  const Real all = none + parts + faults + noisy;
  finding.unchanged = none > 0.5 * all;
  finding.decisive = none < (1 - kDecisive) * all;
  finding.fits =
      window.used >= kUsed * window.next && left <= beyond(kFit, std::max(1, window.freedom));
  if (!finding.decisive) return finding;
  if (finding.likeliest.kind == ChangeKind::noise) {
    sigma[finding.likeliest.which] *= factor;
  } else if (noisy || faults >= 0.5 * all) {
    finding.likeliest = best_of(ChangeKind::fault);
  } else {
    finding.likeliest = best_of(ChangeKind::part);
    for (int k = 0; k < changes.sets; ++k) {
      const Real share = std::exp(gain(k).log_odds - top) / parts;
      const auto [first, count] = steps_of(changes, k);
      for (int j = first; share > kNeglected && j < first + count; ++j) {
        if (j == changes.load && count == 1) {  // constant steps would not tell its amount
          const Real open = 1 + window.product[j * window.widest];
          window.moved += share * window.z[j] / open;
          window.share[j] += share / open;
        } else {
          window.share[j] += share;
        }
      }
    }
  }
  return finding;
}
}  // namespace truepose
