// Settings and memory of the fault monitor.
#pragma once

#include "truepose/control/law.hpp"
#include "truepose/control/tracker.hpp"
#include "truepose/math/chi2.hpp"

namespace truepose {

/// How far a reading is believed.
enum class Health : int {
  valid = 0,
  suspect = 1,  ///< bridged for some cycles, or one of several of which one is wrong
  failed = 2,   ///< until whoever mended it calls acknowledge()
};

/// Why it is not.
enum class Symptom : int {
  none = 0,
  missing = 1,       ///< no number, or one that no sensor gives
  out_of_range = 2,  ///< beyond the motor's stops, or what the sensor can read
  too_fast = 3,      ///< farther from where it was going than any torque can take it
  stuck = 4,         ///< the same counts while the robot moves
  disagrees = 5,     ///< with the other readings
};

/// Constant during a run. Fill it, then call prepare().
struct FaultMonitorSettings {
  Real period = 1e-3;           ///< s
  Real false_alarm = 2.78e-10;  ///< chance of one in a cycle, of all tests: 1000 h at 1 kHz
  int refresh = 64;             ///< cycles at most between looks at what the geometry leaves open
  int coast = 5;                ///< cycles a reading is bridged before it has failed
  int decide = 20;              ///< cycles of disagreement before it counts as undecided
  int spikes = 3;               ///< bridged faults, up to 8,
  int within = 1000;            ///< cycles in which so many of them are a failure
  Real replaceable = 3e-3;      ///< σ up to which a motor's reading is replaced, rad or m
  /// Way on which the error of a geometry changes by as much as it is large, m or rad.
  Real correlation = 0.1;
  Extended fastest{};  ///< second derivative of a healthy reading, at most (0: not watched)
  Extended moved{};    ///< motion of the model beside unchanged counts that is too much (0: none)
  Joint kp{}, kd{};  ///< 1/s² and 1/s, by which motors are driven where their encoders stand still
  Joint rests{};     ///< error at which a healthy motor may rest: counts, friction
  Joint shaken{};    ///< largest σ of the innovation per cycle for the same (0: any)
  Extended low{}, high{};  ///< range of a reading (the same: not watched)

  // From prepare():
  Real sigmas = 0;                           ///< of a normal variable that are as unlikely
  std::array<Real, kMaxSensors + 1> chi2{};  ///< by degrees of freedom
  TrackerGains own, together;
};

inline constexpr Real kOwnPole = 0.3;     ///< of a reading's own tracker
inline constexpr Real kParityPole = 0.8;  ///< of the parity's
inline constexpr Real kUnknown = 1e4;    ///< variance of an error of which nothing is known, over V
inline constexpr Real kSamePlace = 0.1;  ///< way, over `correlation`, after which it looks again
inline constexpr int kFollowed = 8;      ///< cycles that a reading's own tracker needs,
inline constexpr int kSettling = 32;     ///< and the parity's, after the start
inline constexpr int kSpikesKept = 8;
inline constexpr Real kNoNumber = 1e9;  ///< rad or m: beyond, a reading is none, as a NaN is

/// Fills what follows from the chance of a false alarm, shared by level and change: whatever asks a
/// reading alone has a bound that no torque reaches, and this chance on top.
inline void prepare(FaultMonitorSettings& settings) {
  const Real each = settings.false_alarm / 2;
  for (int k = 1; k <= kMaxSensors; ++k) settings.chi2[k] = chi2_beyond(each, k);
  settings.sigmas = std::sqrt(settings.chi2[1]);
  settings.own = tracker_gains(kOwnPole);
  settings.together = tracker_gains(kParityPole);
  settings.refresh = std::max(1, settings.refresh);
}

/// What is known of one reading.
struct MonitoredReading {
  Health health = Health::valid;
  Symptom symptom = Symptom::none;  ///< the latest
  bool begun = false;               ///< there was a number to begin with
  Tracker own;
  Real spread = 0;  ///< mean square of its innovations
  Real raw = 0;     ///< as read in the last cycle
  Real model = 0;   ///< what the model said when it changed last
  int still = 0;    ///< cycles since it changed, as far as they matter
  Real seems = 0;   ///< of a motor: the error that has come up since, beyond `rests`,
  Real speed = 0;   ///< how fast that drives it,
  Real way = 0;     ///< and how far
  Real behind = 0;  ///< of a motor: desired less believed, when it was believed last
  Real usual = 0;   ///< its mean while the motor moves,
  Real off = 0;     ///< by how much it was more when that moved last,
  Real strays = 0;  ///< and mean square of that
  int bridged = 0;  ///< cycles in a row
  std::int64_t left = -kSettling;  ///< beside late sensors: the last cycle in which a motor's
                                   ///< reading left its own track
  std::int64_t spikes = 0;
  std::array<std::int64_t, kSpikesKept> spike{};  ///< the cycles of the latest
};

/// What the watch remembers. Plain data, the caller's; a new one starts anew.
struct FaultMonitor {
  std::array<MonitoredReading, kMaxReadings> reading;
  std::uint32_t doubted = 0;  ///< readings of which one is wrong, as bits; 0: nothing disagrees
  int disagreed = 0;  ///< twice the cycles in which they do and none can be named, less the others
  bool undecided = false;        ///< for so long that none will be: the robot should stop
  std::uint32_t lost = 0;        ///< failed motors that nothing else could stand for, once
  std::uint32_t without = 0;     ///< failed readings that something else stood for in this cycle
  std::uint32_t held = 0;        ///< doubted motors that go where they are asked to go
  bool changed = false;          ///< one of the two has: what the law sees may jump
  std::int64_t cycle = 0;        ///< since the first one in which there was a pose,
  std::int64_t began = 0;        ///< and in which the parity's trackers began to settle
  bool placed = false;           ///< `pose` is known
  Pose pose;                     ///< of the motors that are believed
  Coordinates motion{}, last{};  ///< of this cycle, of the one before
  Real way = 0;                  ///< since the last look at what the geometry leaves open
  std::array<Tracker, kMaxSensors> parity;
  Real chi2 = 0;                                ///< level of the parity
  int freedom = 0;                              ///< its degrees of freedom
  bool known = false;                           ///< the next two are
  Matrix<kMaxSensors, kMaxSensors> geometry{};  ///< P H_ξ Σ_ξ H_ξᵀ Pᵀ
  Extended beyond{};                            ///< what the full level adds to h
};

/// A reading that was mended is believed again. What it says now counts as right, as at the start:
/// while the trackers settle, all readings are only asked whether they are numbers within range.
inline void acknowledge(FaultMonitor& watch, int reading) {
  if (reading < 0 || reading >= kMaxReadings) return;
  MonitoredReading anew;
  anew.own = watch.reading[reading].own;  // what stands for it until there is a number
  watch.reading[reading] = anew;
  watch.doubted = watch.lost = 0;
  watch.undecided = false;
  watch.disagreed = 0;
  watch.began = watch.cycle;
}

namespace watch_detail {

/// A reading is bridged once more. Too long, or too often, and it has failed.
/// @param every  cycles for which one sample stands
inline void bridge(const FaultMonitorSettings& settings, std::int64_t cycle, Symptom symptom,
                   int every, MonitoredReading& reading) {
  const auto spike = [&](std::int64_t k) -> std::int64_t& {
    return reading.spike[static_cast<std::size_t>(k % kSpikesKept)];
  };
  reading.symptom = symptom;
  reading.health = Health::suspect;
  if (reading.bridged++ == 0) spike(reading.spikes++) = cycle;
  const int k = settings.spikes;
  const bool often = reading.spikes >= k && cycle - spike(reading.spikes - k) < settings.within;
  if (reading.bridged > settings.coast * every || often) reading.health = Health::failed;
}

}  // namespace watch_detail

}  // namespace truepose
