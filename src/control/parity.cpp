#include "control/parity.hpp"

namespace truepose {
Verdict parity_verdict(const Parity& parity, const std::array<Real, kMaxSensors + 1>& most,
                       const ReadingCovariance& V, const Reading& value, int r,
                       std::uint32_t without, int left_out) {
  Verdict verdict;
  Reading y = value;
  V.whiten(r, y.data(), 1);
  for (int k = 0; k < r; ++k) verdict.chi2 += y[k] * y[k];
  verdict.freedom = std::max(0, r - left_out);
  const auto at = static_cast<std::size_t>(verdict.freedom);
  verdict.alarm = at > 0 && !(verdict.chi2 <= most[at]);
  if (!verdict.alarm) return verdict;
  verdict.by.fill(0);
  for (int c = 0; c < parity.n + r; ++c) {
    if (without & bit(c)) continue;
    Reading g = parity.signature(r, c);
    V.whiten(r, g.data(), 1);
    Real size = 0, along = 0;
    for (int k = 0; k < r; ++k) {
      size += g[k] * g[k];
      along += g[k] * y[k];
    }
    if (!(size > 0)) continue;
    if (at > 1 && verdict.chi2 - along * along / size > most[at - 1]) continue;
    verdict.may |= bit(c);
    verdict.by[c] = along / size;
  }
  return verdict;
}
}  // namespace truepose
