// Noise, counts and slow samples of one reading.
#include "check.hpp"
#include "control/reading_noise.hpp"

using namespace truepose;

namespace {
constexpr double kSigma = 1e-4;
constexpr int kFades = 1000;

/// A smooth motion of up to 30 rad/s².
double moves(int k) { return 0.3 * std::sin(0.01 * k); }
}  // namespace

TEST("motion, counts, a jump and a spike are no noise") {
  ReadingNoise noise;
  for (int k = 0; k < 2000; ++k) {
    const double count = kSigma * std::sqrt(12), jump = k > 700 ? 0.1 : 0, spike = k == 1300;
    noise.sample(count * std::round((moves(k) + jump + spike) / count), kSigma, kFades);
    CHECK(!noise.noisy());
  }
}

TEST("noise is recognised within six cycles, with its sigma, and fades after a burst") {
  for (const double size : {20, 100}) {
    check::Random random(3);
    ReadingNoise noise;
    int first = -1;
    double sum = 0;
    for (int k = 0; k < 1000; ++k) {
      // The sum of three uniform variables of variance 1/3 is nearly normal.
      const double normal = random() + random() + random();
      noise.sample(moves(k) + (k < 100 ? 0 : size * kSigma * normal), kSigma, kFades);
      CHECK(k >= 100 || !noise.noisy());
      if (first < 0 && noise.noisy()) first = k;
      if (k >= 200) sum += noise.sigma / 800;
    }
    CHECK(first >= 100 && first < 110);
    CHECK(sum > size * kSigma && sum < 2.5 * size * kSigma);  // of the largest of its estimates
    for (int k = 1000; k < 1000 + 6 * kFades; ++k) noise.sample(moves(k), kSigma, kFades);
    CHECK(!noise.noisy());
  }
}

TEST("a held reading has its interval and the motion that it leaves out, until it moves again") {
  ReadingNoise noise;
  for (int sample = 0; sample < 20; ++sample) noise.changed(5, 0.01 * sample, 1e-3);
  CHECK(noise.interval == 5);
  CHECK(std::fabs(noise.grain - 0.19) < 1e-12);
  CHECK(std::fabs(noise.variance() - 0.19 * 0.19 / 12) < 1e-12);
  for (int k = 0; k < 400; ++k) noise.changed(1, 1e-4, 1e-3);
  CHECK(!noise.noisy());
}

TEST("a smoothed motor follows its loop between samples, and its samples in the mean") {
  constexpr double kPeriod = 1e-3, kRate = 100;
  ReadingNoise noise;
  noise.grain = 1;
  noise.off = {1e-3, 0};
  double last = 1e-3;
  for (int k = 1; k < 200; ++k) {  // critically damped, without a sample
    last = noise.smooth(kPeriod, 0.5, false, kSigma, 10, kRate * kRate, 2 * kRate);
    const double t = kRate * kPeriod * k;
    CHECK(std::fabs(last - 1e-3 * (1 + t) * std::exp(-t)) < 6e-5);
  }
  for (int k = 0; k < 500; ++k) last = noise.smooth(kPeriod, 2e-3, true, kSigma, 10, 0, 0);
  CHECK(std::fabs(last - 2e-3) < 1e-5);
}
