// The result of every function of the real-time core.
#pragma once

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

/// Text of a status.
constexpr const char* describe(Status status) {
  switch (status) {
    case Status::stopped: return "stopped learning";
    case Status::disagree: return "readings disagree";
    case Status::near_singular: return "near singular";
    case Status::ok: return "ok";
    case Status::unreachable: return "unreachable";
    case Status::singular: return "singular";
    case Status::branch_lost: return "branch lost";
    case Status::not_finite: return "not finite";
    case Status::not_measured: return "not measured";
    case Status::no_full_level: return "no full level";
    case Status::joint_limit: return "beyond a joint limit";
    case Status::not_converged: return "not converged";
    case Status::no_such_part: return "no such part";
    case Status::not_square: return "fewer motors than freedoms, or more than a function takes";
    case Status::unfinished: return "not finished";
    case Status::no_chains: return "not for a mechanism of bodies and closures";
    case Status::other_version: return "made for another version";
    case Status::too_small: return "too little memory, or not aligned";
    case Status::no_such_value: return "no such value";
  }
  return "unknown status";
}

/// Status and its chain, of a described mechanism its closure (joint_limit: motor), for `disagree`
/// its reading (0-based, -1: none). True: there is an answer.
struct [[nodiscard]] Outcome {
  Status status = Status::ok;
  int chain = -1;
  constexpr explicit operator bool() const { return status <= Status::ok; }
};
}  // namespace truepose
