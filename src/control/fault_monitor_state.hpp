// Settings and state of the fault monitor.
#pragma once

#include "control/driven_way.hpp"
#include "control/law.hpp"
#include "control/parity.hpp"
#include "control/tracker.hpp"
#include "math/chi2.hpp"

namespace truepose {
/// Health of a reading.
enum class Health : int {
  valid = 0,
  suspect = 1,  ///< extrapolated for some cycles, or one of several candidates for a fault
  failed = 2,   ///< until it is repaired and acknowledge() is called
};

/// Reason why a reading is not valid.
enum class Symptom : int {
  none = 0,
  missing = 1,       ///< no number, or larger than any sensor gives
  out_of_range = 2,  ///< beyond the motor's stops or the sensor's range
  too_fast = 3,      ///< farther from its prediction than any torque can take it
  stuck = 4,         ///< unchanged counts while the robot moves
  disagrees = 5,     ///< with the other readings
};

/// Constant during a run. Fill it, then call prepare().
struct FaultMonitorSettings {
  std::uint32_t size = sizeof(truepose_fault_monitor_settings);  ///< for the C interface
  int refresh = 64;             ///< cycles at most between updates of the geometry's covariance
  int coast = 5;                ///< cycles of extrapolation before a reading has failed
  int decide = 20;              ///< cycles of disagreement before the fault counts as undecided
  int spikes = 3;               ///< so many extrapolated faults, up to 8,
  int within = 1000;            ///< in so many cycles are a failure
  Real period = 1e-3;           ///< s
  Real false_alarm = 2.78e-10;  ///< probability per cycle, all tests: one in 1000 h at 1 kHz
  Real replaceable = 3e-3;      ///< largest σ of a motor's virtual reading, rad or m
  /// Travel over which a geometry's error changes by its own size, m or rad.
  Real correlation = 0.1;
  Real stop = 0.15;  ///< duration of a stop along the path, s
  /// Duration with a lost motor, s: about twice the closing time of a brake (20 ms, assumed). The
  /// brake stops that motor wherever the path is by then; the error is the others' way left.
  Real stop_lost = 0.04;
  Real held = 0.005;       ///< longest time for which the last valid torque is held, s
  Extended fastest{};      ///< largest second derivative, per s² (0: not tested)
  Extended moved{};        ///< model motion that shows a stuck reading, rad or m (0: not tested)
  Joint kp{}, kd{};        ///< 1/s² and 1/s: loops that drive a motor with a frozen encoder
  Joint rests{};           ///< error at which a healthy motor may rest (counts, friction), rad or m
  Joint shaken{};          ///< largest σ of a virtual reading's noise per cycle, rad or m (0: any)
  Extended low{}, high{};  ///< range of a reading, rad or m (equal: not tested)

  // Not in truepose_fault_monitor_settings: from prepare().
  Real sigmas = 0;    ///< limit of a normal variable with the same probability
  Real decisive = 0;  ///< difference of log odds that isolates a reading: chance is as rare
  std::array<Real, kMaxSensors + 1> chi2{};  ///< limits, by degrees of freedom
  TrackerGains own, together;
};

inline constexpr Real kOwnPole = 0.3;     ///< of a reading's own tracker
inline constexpr Real kParityPole = 0.8;  ///< of the parity's trackers
inline constexpr Real kUnknown = 1e4;     ///< variance of an unknown error, over V
inline constexpr Real kSamePlace = 0.1;   ///< travel between updates, over `correlation`
inline constexpr int kFollowed = 8;       ///< cycles for a reading's own tracker,
inline constexpr int kSettling = 32;      ///< and for the parity's, to settle after the start
inline constexpr int kStill = 3;          ///< unchanged cycles after which a reading stands still
inline constexpr int kSpikesKept = 8;
/// Share of `moved` above which a reading that stands still during a disagreement is isolated, or
/// one whose motor was driven off.
inline constexpr Real kStoodBy = 0.4;

/// Computes the limits from the false-alarm probability, shared by the level and change tests.
/// Tests of single readings have a bound that no torque reaches, with this margin on top.
void prepare(FaultMonitorSettings& settings);

/// A reading that stays the same, while its model and its motor may move on. rad or m, and s.
struct Standstill {
  Real reading = 0;          ///< the value that stays
  Real model = 0;            ///< the model's value when the reading changed last
  Real setpoint_motion = 0;  ///< sensors: the setpoint's motion since then, by the model
  Real forced_error = 0;     ///< motors: error that external forces caused then
  DrivenWay driven;          ///< from the setpoint then; motors: by a frozen encoder
  int cycles = 0;            ///< since then, up to 1000
  bool stuck = false;        ///< too far from its model: extrapolated until it changes or fails

  /// Whether it may be a frozen encoder that drives its motor away.
  bool may_be_frozen() const { return cycles >= kStill && driven.error != 0; }
};

/// Following error of a motor, desired minus actual, rad or m.
struct FollowingError {
  Real now = 0;        ///< when its reading was last believed
  Real usual = 0;      ///< mean while the motor moves,
  Real deviation = 0;  ///< from that at the last motion,
  Real variance = 0;   ///< and the mean square of the deviations
  Tracker led_out;     ///< of a motor with a stuck encoder: as its loop reduces it
};

/// Times at which a reading was extrapolated.
struct Extrapolations {
  int cycles = 0;                                 ///< consecutive ones
  std::int64_t count = 0;                         ///< of all times but standstills,
  std::array<std::int64_t, kSpikesKept> begun{};  ///< and the cycles in which the latest began
};

/// State of one reading.
struct MonitoredReading {
  Health health = Health::valid;
  Symptom symptom = Symptom::none;  ///< the latest
  bool begun = false;               ///< a first number was read
  Tracker track;                    ///< position and rate
  Real scatter = 0;                 ///< mean square of the track's innovations
  Standstill standstill;
  FollowingError following;  ///< motors
  Extrapolations extrapolated;
  std::int64_t left_track = -kSettling;  ///< motors beside delayed sensors: latest such cycle
};

/// A disagreement of the readings, from its first cycle on.
struct Disagreement {
  int cycles = 0;     ///< with an alarm
  int undecided = 0;  ///< +2 per cycle with several candidates, -1 per cycle without alarm
  Reading change{};   ///< sum of the parity's changes in these cycles,
  Reading level{};    ///< and of its values
  Extended jump{};    ///< innovations of the readings' tracks in the first one
};

/// State of the fault monitor. Plain data, the caller's; a new one starts afresh. The pose is that
/// of the believed motors.
struct FaultMonitor : MotorsPose {
  std::array<MonitoredReading, kMaxReadings> reading;
  std::uint32_t doubted = 0;  ///< candidates for the fault, as bits; 0: no disagreement
  Disagreement disagreement;
  bool undecided = false;     ///< for too long to be isolated: the robot should stop
  std::uint32_t lost = 0;     ///< failed motors that once had no substitute
  std::uint32_t without = 0;  ///< failed readings substituted in this cycle
  std::uint32_t held = 0;     ///< candidate motors held at their setpoints
  bool changed = false;       ///< `without` or `held` changed: the law's input may jump
  std::int64_t cycle = 0;     ///< since the first one with a pose,
  std::int64_t began = 0;     ///< and in which the parity's trackers began to settle
  Coordinates last{};         ///< `motion` of the cycle before
  Real way = 0;               ///< since the last update of the geometry's covariance
  Joint pushed{};             ///< motor errors that external forces cause
  Joint desired{};            ///< q_d of the last cycle
  Joint led{};                ///< by which drives' own loops have led the motors off q_d
  std::array<Tracker, kMaxSensors> parity;
  Reading usual{};     ///< its mean over some cycles
  Real chi2 = 0;       ///< of the tested parity, its level or its change
  int freedom = 0;     ///< its degrees of freedom
  bool known = false;  ///< the next two are valid
  ParityGeometry geometry{};
  Parasitic rest;     ///< residual motion there
  Extended beyond{};  ///< what the full level adds to h

  /// The failed ones of the first readings, as bits.
  std::uint32_t failed(int count) const {
    std::uint32_t bits = 0;
    for (int c : range(count)) bits |= reading[c].health == Health::failed ? bit(c) : 0;
    return bits;
  }
  /// Motors whose readings the law does not use, as bits.
  std::uint32_t unused(int motors) const {
    std::uint32_t bits = held | failed(motors);
    for (int i : range(motors)) bits |= reading[i].extrapolated.cycles > 0 ? bit(i) : 0;
    return bits;
  }
};

/// Marks a repaired reading as valid. Its present value counts as right, as at the start: while the
/// trackers settle, readings are only tested to be numbers within range.
void acknowledge(FaultMonitor& monitor, int reading);
}  // namespace truepose
