// Noise of a reading, its sampling interval, and a smoothed reading.
//
// Third differences of the samples contain noise (variance 20 σ²) and hardly any motion (jerk ·
// T³). Their median over eight cycles is insensitive to a jump (three large differences) and to a
// spike (four). A reading that stands still while its model moves and then follows is sampled more
// slowly than the control cycle (held) or in coarse counts: its error is uniform over the motion
// that it leaves out, its grain.
//
// A noisy reading is replaced by its model minus a tracked deviation. A motor's deviation is its
// following error, which decays as the motor's loop makes it; between two samples it is predicted.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "control/tracker.hpp"

namespace truepose {
inline constexpr int kThirds = 8;  ///< third differences of the median
inline constexpr Real kNoisy = 6;  ///< σ over the expected one from which a reading is noisy,
inline constexpr Real kQuiet = 2;  ///< and below which it is not any more
inline constexpr Real kFinest =
    2e-5;  ///< least σ with which a reading's noise is compared, rad or m
inline constexpr Real kUnmodelled =
    0.02;  ///< share of the largest acceleration that no model predicts

/// 1 minus the pole of the tracked deviation: least, largest, and largest of a held reading.
inline constexpr Real kLeastShare = 0.02, kMostShare = 0.7, kSampledShare = 0.3;

/// Largest σ of a noise that a smoothed reading leaves below `left`: σ √(5/4 T √(a/σ)), see
/// smooth(). It is a fixed point: each pass takes three quarters off the logarithm's error.
/// @param acceleration  a, largest unmodelled one
Real noisiest(Real period, Real acceleration, Real left);

/// State of one reading's noise.
struct ReadingNoise {
  std::array<Real, 3> past{};         ///< last samples, the newest first
  std::array<Real, kThirds> third{};  ///< magnitudes of the last third differences
  std::uint32_t beyond = 0;           ///< those beyond any healthy one, as bits,
  int large = 0;                      ///< and their number: noise may be beginning
  int newest = -3;    ///< place of the next third difference; below 0: samples that it lacks
  Real sigma = 0;     ///< beyond the expected noise; 0: not noisy
  Real grain = 0;     ///< motion between two changes of a held or coarse reading; 0: neither
  Real interval = 0;  ///< cycles between two changes
  Tracker off;        ///< model minus reading, smoothed,
  Real gain = 1;      ///< by this gain on the noise's variance

  bool noisy() const { return sigma + grain > 0; }
  /// Whether it is noisy or may become so. A jump leaves three large differences.
  bool may_be_noisy() const { return noisy() || large > 3; }
  /// Variance beyond that of the expected noise.
  Real variance() const { return sigma * sigma + grain * grain / 12; }

  /// Updates σ with a sample. @param expected  σ @param fades  cycles in which a burst's σ decays
  void sample(Real raw, Real expected, int fades);

  /// Updates the sampling when the reading changes after `still` cycles. @param left_out  the
  /// model's motion meanwhile @param least  a smaller grain is none
  void changed(int still, Real left_out, Real least);

  /// Predicts the deviation, which a motor's loop reduces. @return it one period later
  Real predict(Real period, Real kp, Real kd);

  /// Tracks the deviation. @param deviation  model minus reading @param fresh  the reading changed
  /// @param acceleration  largest unmodelled one @param kp, kd  of a motor's loop; 0: sensors
  /// @return the smoothed deviation
  Real smooth(Real period, Real deviation, bool fresh, Real expected, Real acceleration, Real kp,
              Real kd);
};
}  // namespace truepose
