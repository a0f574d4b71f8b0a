// Readings of faulty sensors.
#pragma once

#include <limits>
#include <random>
#include <vector>

#include "mechanism/sensor.hpp"

namespace truepose {
/// Kinds of faulty readings. s is the healthy reading, including noise and quantization.
enum class FaultKind : int {
  bias = 0,     ///< s + size
  jump = 1,     ///< s + size, permanently: lost encoder counts never return
  spike = 2,    ///< s + size, once
  stuck = 3,    ///< s at the beginning of the fault
  dropout = 4,  ///< nothing: NaN
  drift = 5,    ///< s + size · time since the fault began
  sign = 6,     ///< -s
  gain = 7,     ///< size · s
  delay = 8,    ///< s, delayed by size seconds
  swap = 9,     ///< the other reading's s, and vice versa: connectors exchanged
  noise = 10,   ///< s + Gaussian noise of σ = size, new in every cycle
  coarse = 11,  ///< s in counts that are coarser by the factor size
  hold = 12,    ///< s, each value held for size seconds
  loose = 13,   ///< s, but 0 for one to three cycles at random: a loose contact
};

/// Properties of a kind of fault.
struct FaultProperties {
  FaultKind kind;
  const char* name;
  const char* size;      ///< unit of size; "reading": that of the reading; empty: no size
  bool lasts = true;     ///< may have an end
  bool at_rest = false;  ///< meaningful for a robot at rest, without time
  bool pair = false;     ///< needs another reading
};

/// In the order of FaultKind. Single source for all code, including Python.
inline constexpr std::array kFaultTable{
    FaultProperties{.kind = FaultKind::bias, .name = "bias", .size = "reading", .at_rest = true},
    FaultProperties{FaultKind::jump, "jump", "reading", false, true},
    FaultProperties{FaultKind::spike, "spike", "reading", false},
    FaultProperties{FaultKind::stuck, "stuck", ""},
    FaultProperties{FaultKind::dropout, "dropout", ""},
    FaultProperties{FaultKind::drift, "drift", "reading/s"},
    FaultProperties{.kind = FaultKind::sign, .name = "sign", .size = "", .at_rest = true},
    FaultProperties{.kind = FaultKind::gain, .name = "gain", .size = "1", .at_rest = true},
    FaultProperties{FaultKind::delay, "delay", "s"},
    FaultProperties{
        .kind = FaultKind::swap, .name = "swap", .size = "", .at_rest = true, .pair = true},
    FaultProperties{FaultKind::noise, "noise", "reading"},
    FaultProperties{FaultKind::coarse, "coarse", "1"},
    FaultProperties{FaultKind::hold, "hold", "s"},
    FaultProperties{FaultKind::loose, "loose", ""},
};
static_assert(in_order(kFaultTable, &FaultProperties::kind));

constexpr const FaultProperties& properties(FaultKind kind) {
  return kFaultTable[std::size_t(kind)];
}

/// One reading that is faulty for a time.
struct Fault {
  FaultKind kind = FaultKind::bias;
  int reading = 0;   ///< of the extended positions
  int other = 0;     ///< reading it is exchanged with
  double size = 0;   ///< in the kind's unit
  double begin = 0;  ///< s; the first reading at this time or later is faulty
  double end = std::numeric_limits<double>::infinity();  ///< s; the first healthy one again
  double count = 0;    ///< of coarse: the reading's healthy count, in its unit
  bool frame = false;  ///< one of those of a whole frame: its counter stands still as well
};

inline constexpr int kMostLate = 10000;  ///< control periods of the maximum delay

/// Applies faults to readings; stateful: one object per running robot.
class FaultyReadings {
 public:
  /// @param faults  each acts on the result of the preceding ones
  /// @param period  between readings, s: a delayed reading is the newest of sufficient age
  /// @param seed    of noise and loose contacts
  FaultyReadings(const std::vector<Fault>& faults, double period, std::uint64_t seed = 0);

  /// Makes the healthy readings faulty. Call it once per sample, in order.
  void make_faulty(double time, Extended& q_e);

  /// Whether the frame's counter stands still.
  bool frozen(double time) const;

  /// Factor by which readings may overstate the robot's motion, at least 1.
  double amplification() const;

 private:
  struct State {
    Fault fault;
    std::vector<double> past;  ///< ring of the last healthy readings, or the stuck one
    std::size_t newest;
    bool began;
    double since = 0;  ///< s, when the held value was read
    int open = 0;      ///< cycles for which a contact is still open
  };

  static constexpr double kOpens = 0.05;  ///< chance that a loose contact opens in a cycle,
  static constexpr int kOpen = 3;         ///< for up to so many
  static constexpr double kClock = 1e-9;  ///< s: k·period is not exactly a decimal time

  static bool acts(double time, const Fault& fault);

  void apply(double time, State& state, Extended& q_e);

  /// Records a reading; before the first one the robot was at rest.
  void remember(double healthy, State& state) const;

  double period_;
  std::mt19937_64 random_;
  std::vector<State> state_;
};
}  // namespace truepose
