// Age of frames of readings, from their counter or timestamp.
#pragma once

#include <cstdint>

#include "math/real.hpp"

namespace truepose {
/// Mark of a frame: its counter or timestamp, if it has one.
struct FrameMark {
  bool given = false;
  std::uint64_t value = 0;
};

enum class FrameAge : int { fresh = 0, repeated = 1, old = 2, dropped = 3, backwards = 4 };

/// Clock rate error that the sender may have without its frames counting as older and older.
inline constexpr Real kClockDrift = 1e-3;
/// Deviation of a timestamp, in periods, that does not count as age.
inline constexpr Real kJitter = 0.5;

/// Follows one kind of mark from cycle to cycle.
struct FrameClock {
  bool begun = false;
  std::uint64_t last = 0;
  Real behind = 0;  ///< age, in periods, over that of the freshest frame so far
  Real jitter = 0;  ///< largest deviation of an advance from one period, in periods

  /// One cycle with a frame. Repeated and late frames add to its age; an advance by more than one
  /// period makes up for them, by much more it has dropped frames.
  /// @param per   units of the mark per period: 1 for a counter, the period for a timestamp
  /// @param mask  values of the mark: it wraps
  /// @param age   oldest admissible, in periods
  FrameAge advance(FrameMark mark, Real per, std::uint64_t mask, int age);
};
}  // namespace truepose
