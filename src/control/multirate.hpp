// Multirate and delayed sensors: prediction of their present value.
//
// A reading is h(x) + p, h the sensor's model at the motors' pose x. That pose may be off by
// millimetres, but its motion over a few milliseconds only by a hundredth of itself: p, the
// geometry's error, is a slow function of the pose. A sample y taken at s gives until the next one
//
//     p = y - h(x(s)),        reading now = h(x(t)) + p
//
// Fast motion comes from the motors. A loop closed through p is delayed and must be slow: laws use
// p behind a low-pass with the time constant of its delay, slower for changes below counts, which
// would cause a limit cycle. The change of p since the sample is an error of the reading, with
// variance |sensitivity (x(t) - x(s))|².
//
// s is the arrival minus the sensor's latency, or the sample's own timestamp: then jitter of the
// latency costs no accuracy. Between cycles x(s) and h(x(s)) are interpolated.
#pragma once

#include "control/law.hpp"
#include "control/parity.hpp"

namespace truepose {
inline constexpr int kOldest = 255;       ///< largest latency, control periods
inline constexpr int kSlowest = 1 << 20;  ///< largest sample period, control periods
inline constexpr Real kCalmest = 0.1;  ///< factor on the low-pass's gain for changes below counts
inline constexpr Real kCounts = 3;     ///< σ above which p is followed rather than averaged
inline constexpr int kDropped = 5;     ///< sample periods without a sample: the reading is missing

/// Slow and delayed sensors. Constant during a run: fill it, then call start().
struct MultirateSettings {
  std::uint32_t size = sizeof(truepose_multirate_settings);  ///< for the C interface
  std::uint32_t stamped = 0;  ///< sensors whose samples have timestamps, as bits: see stamp()
  std::array<int, kMaxSensors> every{};  ///< sample period, control periods; 0 as 1
  std::array<int, kMaxSensors> age{};    ///< latency of a sample on arrival, control periods
  Real period = 1e-3;                    ///< of control, s, for timestamps
  /// Change of p along each freedom of the platform, σ: rad or m, per m or rad.
  Matrix<kMaxSensors, kMaxDof> sensitivity{};

  bool is(int sensor) const {
    return every[sensor] > 1 || age[sensor] > 0 || (stamped & bit(sensor)) != 0;
  }
};

/// Sensors' values and motion of the pose, by the motors at one time.
struct ByMotors {
  Reading expected{};  ///< h
  Coordinates way{};   ///< motion of the pose since the start
};

/// State of these sensors. Plain data, the caller's. Pose and h are the motors'.
struct Multirate : MotorsPose, ByMotors {
  // From start():
  MultirateSettings settings;
  std::uint32_t which = 0;  ///< slow and delayed sensors, as bits
  Reading pole{};           ///< of each one's low-pass

  std::uint32_t arrived = 0;  ///< in: sensors with a new sample, as bits; the cycle clears it
  Reading age{};              ///< of each one's latest on arrival, control periods
  std::uint32_t timed = 0;    ///< sensors with a timestamp so far, as bits,
  std::array<std::uint64_t, kMaxSensors> taken{};  ///< the latest, ns
  Reading since{};                                 ///< periods since the latest sample was taken

  std::int64_t cycle = 0;                   ///< next one
  Reading change{};                         ///< of h in the last cycle
  Reading noise{};                          ///< variance of h by the motors' noise and counts
  std::array<ByMotors, kOldest + 1> was{};  ///< ring buffer
  Reading sample{};                         ///< latest that arrived, as read,
  Reading then{};                           ///< h when it was taken,
  Matrix<kMaxSensors, kMaxDof> there{};     ///< `way` then,
  Matrix<kMaxSensors, kMaxDof> before{};    ///< `way` of the sample before,
  Reading off{};                            ///< and p
  Reading slow{};                           ///< p behind the low-pass; of sensors in `begun`
  Matrix<kMaxSensors, kMaxDof> slowly{};    ///< `there`, likewise
  std::uint32_t begun = 0;
  Reading present{};  ///< extrapolated readings

  bool is(int sensor) const { return (which & bit(sensor)) != 0; }
};

/// Starts afresh. @return no_such_part and the first sensor with an invalid period or latency
Outcome start(const MultirateSettings& settings, Multirate& late);

/// Sensors with a sample arriving in a cycle, as bits, if the controller's clock, whole cycles from
/// 0, triggers them. In the first cycle all arrive: the robot stood still before.
std::uint32_t arrivals(const MultirateSettings& settings, std::int64_t cycle);

/// Adds a sample with a timestamp to those that arrive in this cycle.
/// @param time, now  of the sample and of the cycle's motor readings by the same clock, ns; they
/// may wrap
/// @return false: as if not arrived. It is repeated or older than the sample before, is from the
/// future, or is older than kOldest periods
bool stamp(Multirate& late, int sensor, std::uint64_t time, std::uint64_t now);

/// Runs one cycle: extrapolates delayed readings to the present. Set `late.arrived` before; see
/// arrivals(). While the motors have no pose, h continues at its last rate.
/// @param robot  finished, with the sensors of `late`
/// @param q_e    in: readings; out: slow and delayed ones as of now, NaN after a NaN sample
/// @return no answer: the first cycle has no pose, and does not count
Outcome compensate_latency(const Robot& robot, Multirate& late, Extended& q_e);

/// Low-passes p for the laws, after the fault monitor.
/// @param q_e    in and out: delayed readings as of now
/// @param holds  keep p: delayed values must not drive a motor without a reading
void low_pass(const Robot& robot, Multirate& late, Extended& q_e, bool holds = false);

/// Variance of the change of p. @param since  `way` where p is known
Real latency_variance(const Multirate& late, int sensor, const std::array<Real, kMaxDof>& since);

/// Raises the σ of delayed readings for the laws: p may have changed since the sample behind the
/// low-pass, and h has the motors' noise and counts. @param known  in and out
void weigh(const Robot& robot, const Multirate& late, Knowledge& known);

/// Latency-compensated readings for a law without a fault monitor.
/// @param q_e    in and out
/// @param known  out: the readings' knowledge with their present σ
/// @return their weighting
Weighing compensated(const Robot& robot, const Weighing& weighing, Multirate& late,
                     Knowledge& known, Extended& q_e);
}  // namespace truepose
