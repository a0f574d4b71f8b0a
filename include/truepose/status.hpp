// The result of every function of the real-time core.
#pragma once

#include <array>
#include <cstddef>

#include "truepose/truepose.h"

namespace truepose {
/// Result of every core function; nothing throws. Below 0: answer with a warning; above 0: none.
enum class [[nodiscard]] Status : int {
  stopped = -3,        ///< readings disagreed too long: identification has stopped
  disagree = -2,       ///< readings disagree: some or all were excluded from identification
  near_singular = -1,  ///< damped as requested: finite and bounded, not the exact law's answer
  ok = 0,              ///< converged or computed; the outputs are finite
  unreachable = 1,     ///< certainly no position of the mechanism closes the loops
  singular = 2,        ///< J_x or J_q loses rank: the answer is not determined
  branch_lost = 3,     ///< closed, but not in the robot's working or assembly mode
  not_finite = 4,      ///< an input is NaN or infinite
  not_measured = 5,    ///< the sensors do not determine what the law needs
  no_full_level = 6,   ///< the rods are too many, too few or unknown for the full level
  joint_limit = 7,     ///< a motor would have to pass one of its stops
  not_converged = 8,   ///< the search ended with open loops; a solution may exist
  no_such_part = 9,    ///< a count, index or enum of the robot's data is invalid
  not_square = 10,     ///< fewer motors than freedoms or chains, or more than a function takes
  unfinished = 11,     ///< the robot has not passed finish() (jacobian.hpp)
  no_chains = 12,      ///< a mechanism of bodies and closures, where only chains are modelled
  other_version = 13,  ///< a table from another version of the library, or of another size
  too_small = 14,      ///< the given memory is too small or not aligned
  no_such_value = 15,  ///< a number outside its valid range, or a matrix that is no rotation
};

/// Texts of all statuses, in their order.
inline constexpr std::array kStatusTexts{
    "stopped learning",
    "readings disagree",
    "near singular",
    "ok",
    "unreachable",
    "singular",
    "branch lost",
    "not finite",
    "not measured",
    "no full level",
    "beyond a joint limit",
    "not converged",
    "no such part",
    "fewer motors than freedoms, or more than a function takes",
    "not finished",
    "not for a mechanism of bodies and closures",
    "made for another version",
    "too little memory, or not aligned",
    "no such value",
};
static_assert(kStatusTexts.size() == 1 + int(Status::no_such_value) - int(Status::stopped));

/// Text of a status.
constexpr const char* describe(Status status) {
  const auto k = std::size_t(int(status) - int(Status::stopped));
  return k < kStatusTexts.size() ? kStatusTexts[k] : "unknown status";
}

/// Status and its chain, of a described mechanism its closure (joint_limit: motor), for `disagree`
/// its reading (0-based, -1: none). True: there is an answer.
struct [[nodiscard]] Outcome {
  Status status;
  int chain;
  constexpr Outcome(Status of = Status::ok, int at = -1) : status(of), chain(at) {}
  /// From C's.
  constexpr Outcome(truepose_outcome of) : Outcome(Status{of.status}, of.part) {}
  constexpr explicit operator bool() const { return status <= Status::ok; }
};
}  // namespace truepose
