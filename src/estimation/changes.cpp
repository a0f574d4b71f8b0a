// Changes of a robot in its life: which of them the rows of a window show.
#include "estimation/changes.hpp"

#include <utility>

namespace truepose {
namespace {
constexpr int kFaults = 2;  ///< steps of a reading's fault: bias, drift

int responses(const ChangeSettings& changes, int readings) {
  return changes.steps + kFaults * readings;
}

/// Steps of a change; after those of the settings, of a reading's fault.
struct Steps {
  int first, count;
};
Steps steps_of(const ChangeSettings& changes, int change) {
  const int fault = change - changes.count;
  if (fault >= 0) return {changes.steps + kFaults * fault, kFaults};
  const int first = change > 0 ? changes.end[change - 1] : 0;
  return {first, changes.end[change] - first};
}

int widest(const ChangeSettings& changes) {
  int most = kFaults;
  for (int k : range(changes.count)) most = max(most, steps_of(changes, k).count);
  return most;
}

/// Evidence of a change, with its rate.
Evidence evidence_of(const ChangeSettings& changes, int change, const Window& window) {
  const auto [first, n] = steps_of(changes, change);
  Real *S = window.scratch, *z = S + n * n;
  for (int i : range(n)) {
    std::copy_n(window.product + (first + i) * window.widest, n, S + i * n);
    z[i] = window.z[first + i];
  }
  Evidence found = evidence(n, S, z);
  found.log_odds += change < changes.count ? changes.log_odds[change] : kLogFault;
  return found;
}
}  // namespace

int lay_out(const Robot& robot, const RootFilter& filter, const ChangeSettings& changes,
            Real* memory, Window& window) {
  const int m = readings(robot), K = responses(changes, m), n = widest(changes);
  const int p = filter.count, width = parameter_count(robot);
  int taken = 0;
  const auto take = [&](int count) {
    taken += count;
    return memory ? memory + taken - count : nullptr;
  };
  window.widest = n;
  for (RootFilter* own : {&window.base, &window.filter})
    *own = {p, filter.column, take(width), take(p * p)};
  window.response = take(K * p), window.z = take(K), window.product = take(K * n);
  window.share = take(changes.steps);
  window.scratch = take(n * (n + 1) + K * redundancy(robot));
  window.stored = take(kStored * m);
  window.about = take(width);
  return taken;
}

void restart(const ChangeSettings& changes, int readings, Window& window, Real* work) {
  RootFilter& filter = window.filter;
  const int K = responses(changes, readings), p = filter.count;
  filter.assign(window.base);
  if (changes.load >= 0)
    for (int j : range(p))
      filter.xi[filter.column[j]] += window.moved * changes.step[changes.load * p + j];
  for (int k : range(changes.steps)) {
    if (!(window.share[k] > 0)) continue;
    for (int j : range(p)) work[j] = sqrt(window.share[k]) * changes.step[k * p + j];
    add_drift(p, filter.root, work);
  }
  std::fill_n(window.response, K * p, 0.0);
  std::fill_n(window.z, K, 0.0);
  std::fill_n(window.product, K * window.widest, 0.0);
  window.noisy = {};
  window.rows = window.used = window.freedom = 0;
  window.chi2 = 0;
  window.gross = false;
}

void add_row(const ChangeSettings& changes, const Extended& sigma, const Equations& row,
             Window& window, Real* work) {
  const int p = window.filter.count, r = row.r, readings = row.readings;
  Real *F = work, *gain = F + r * p;
  Innovations made;
  const Outcome finite = innovate(window.filter, row, F, made);
  ++window.rows;
  const Real chi2 = made.chi2();
  const bool gross = !(chi2 <= beyond(kGate, r));
  // One gross row says nothing of a change; the next ones do.
  if (!finite || (gross && !std::exchange(window.gross, gross))) return;
  window.gross = gross;
  window.chi2 += chi2, window.freedom += r, ++window.used;
  update(made, F, window.filter, gain);
  Real* const every = window.scratch;
  for (int change : range(changes.count + readings)) {
    const auto [first, count] = steps_of(changes, change);
    const int c = change - changes.count;  // reading of a fault
    std::array<Real, kMaxReadings> w;
    for (int k : range(first, first + count)) {
      Real* own = window.response + k * p;
      const Real bias =
          c < 0 ? 0 : kFault / sigma[c] * (k > first ? Real(window.rows) / kWindow : 1);
      for (int i : range(r)) {
        const auto by = [&](int j) { return row.B[i * p + j] * changes.step[k * p + j]; };
        if (c >= 0)
          w[i] = bias * row.G[i * readings + c];
        else
          w[i] = k == changes.load && row.loaded ? row.loaded[i] : sum_of(p, by);
        for (int j : range(p)) w[i] -= row.B[i * p + j] * own[j];
      }
      window.z[k] += made.transform(w).score;
      for (int i : range(r)) {
        const Real share = w[i] / made.total[i];
        every[k * r + i] = w[i];
        for (int j : range(p)) own[j] += gain[i * p + j] * share;
        for (int b : range(first, k + 1))
          window.product[k * window.widest + b - first] += every[b * r + i] * share;
      }
    }
    if (c < 0) continue;
    for (int i : range(r)) w[i] = row.G[i * readings + c];
    const Column error = made.transform(w);
    for (std::size_t f = 0; f < kFactor.size(); ++f)
      window.noisy[f][c] += error.log_odds(kFactor[f] * kFactor[f] - 1);
  }
}

Finding decide(const ChangeSettings& changes, int readings, Window& window, Extended& sigma) {
  Finding finding;
  std::array<Recognised, 3> best;  // of each kind
  for (Recognised& of : best) of.log_odds = -INFINITY;
  const auto best_of = [&](ChangeKind kind) -> Recognised& { return best[std::size_t(kind)]; };
  Real left = window.chi2, top = 0;
  const auto compare = [&](ChangeKind kind, int which, const Evidence& by) {
    Recognised& of = best_of(kind);
    if (by.log_odds > of.log_odds) of = {0, kind, which, by.log_odds};
    if (!(by.log_odds > top)) return false;
    top = by.log_odds, left = window.chi2 - by.chi2;
    finding.likeliest = of;
    return true;
  };
  const auto of = [&](int change) { return evidence_of(changes, change, window); };
  for (int k : range(changes.count)) compare(ChangeKind::part, k, of(k));
  for (int c : range(readings)) compare(ChangeKind::fault, c, of(changes.count + c));
  const Real steps_top = top;
  Real factor = 1;  // of noise, if that is the likeliest
  for (int c : range(readings))
    for (std::size_t f = 0; f < kFactor.size(); ++f) {
      if (kFactor[f] < 1 && sigma[c] < 1.5 * window.sigma[c]) continue;
      const bool wild = kFactor[f] * sigma[c] > kNoisiest * window.sigma[c];
      if (compare(wild ? ChangeKind::fault : ChangeKind::noise, c,
                  {window.noisy[f][c] + kLogNoise, window.chi2}))
        factor = kFactor[f];
    }
  const bool noisy = top > steps_top;
  // Relative to the likeliest.
  const Real none = exp(-top);
  Real parts = 0, faults = 0;
  for (int k : range(changes.count + readings))
    (k < changes.count ? parts : faults) += exp(of(k).log_odds - top);
  const Real all = none + parts + faults + noisy;
  finding.unchanged = none > 0.5 * all;
  finding.decisive = none < (1 - kDecisive) * all;
  finding.fits = window.used >= kUsed * window.next && left <= beyond(kFit, max(1, window.freedom));
  if (!finding.decisive) return finding;
  if (finding.likeliest.kind == ChangeKind::noise) {
    sigma[finding.likeliest.which] *= factor;
  } else if (noisy || faults >= 0.5 * all) {
    finding.likeliest = best_of(ChangeKind::fault);
  } else {
    finding.likeliest = best_of(ChangeKind::part);
    for (int k : range(changes.count)) {
      const Real share = exp(of(k).log_odds - top) / parts;
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
