// Noise of a reading, its sampling interval, and a smoothed reading.
#include "control/reading_noise.hpp"

namespace truepose {
void ReadingNoise::sample(Real raw, Real expected, int fades) {
  const Real difference = std::fabs(raw - 3 * past[0] + 3 * past[1] - past[2]);
  past = {raw, past[0], past[1]};
  constexpr Real kLowerMedian = 0.58 * 4.47;  // of |N(0, 20)|, the fourth of eight
  const Real usual = std::max(expected, kFinest), limit = kNoisy * kLowerMedian * usual;
  const int place = std::max(newest, 0);
  third[place] = newest < 0 ? 0 : difference;
  const std::uint32_t now = third[place] > limit;
  large += static_cast<int>(now) - static_cast<int>(beyond >> place & 1U);
  beyond = (beyond & ~(1U << place)) | now << place;
  newest = newest < kThirds - 1 ? newest + 1 : 0;
  // Else the lower median is below the limit.
  if (sigma == 0 && large <= kThirds / 2) return;
  auto sorted = third;
  std::nth_element(sorted.begin(), sorted.begin() + kThirds / 2 - 1, sorted.end());
  const Real level = sorted[kThirds / 2 - 1] / kLowerMedian;
  if (sigma == 0) {
    sigma = level;
    off.rate = 0;
  } else {
    sigma += level > sigma ? (level - sigma) / kThirds : -sigma / static_cast<Real>(fades);
  }
  if (sigma < kQuiet * usual) sigma = 0;
}

void ReadingNoise::changed(int still, Real left_out, Real least) {
  constexpr Real kFades = 1.0 / 64;
  interval = std::max(static_cast<Real>(still), interval * (1 - kFades));
  grain = std::max(std::fabs(left_out), grain * (1 - kFades));
  if (grain < least) grain = interval = 0;
}

Real ReadingNoise::predict(Real period, Real kp, Real kd) {
  off.rate = (off.rate - period * kp * off.value) / (1 + period * kd);
  return off.predicted(period);
}

Real ReadingNoise::smooth(Real period, Real deviation, bool fresh, Real expected, Real acceleration,
                          Real kp, Real kd) {
  Real innovation = deviation - predict(period, kp, kd);
  // Before noise is recognised, it must not drive a motor's deviation.
  const Real most = kNoisy * std::max(expected, kFinest);
  if (!noisy() && kp > 0) innovation = std::clamp(innovation, -most, most);
  if (grain > 0 && !fresh) innovation -= std::clamp(innovation, -grain, grain);
  const Real chance = std::sqrt(sigma * sigma + expected * expected);
  const Real since = period * std::max<Real>(1, interval);  // s, the last sample
  const Real fast = chance > 0 ? since * std::sqrt(acceleration / chance) : 1;
  // Σh² of an α-β filter with both poles at 1 - share, for small shares: 5/4 share.
  const Real share = std::clamp<Real>(fast, kLeastShare, grain > 0 ? kSampledShare : kMostShare);
  off.value += period * off.rate + share * (2 - share) * innovation;
  off.rate += share * share / since * innovation;
  gain = std::min<Real>(1, 1.25 * share);
  return off.value;
}

Real noisiest(Real period, Real acceleration, Real left) {
  Real sigma = left;
  for (int pass = 0; pass < 30; ++pass)
    sigma = left / std::sqrt(Real{1.25} * period * std::sqrt(acceleration / sigma));
  return sigma;
}
}  // namespace truepose
