// Robots with a full level, and their construction when no axis is exact.
#pragma once

#include "mechanisms.hpp"

namespace mechanisms {

inline constexpr Mobility kH4 = Mobility::schoenflies;

inline std::vector<Mechanism> with_pairs() { return {h4(), delta(), linear_delta()}; }

/// Calls f(mechanism) for every robot with a full level of its own.
template <class F>
void for_each_full(F&& f) {
  for (const Mechanism& mechanism : with_pairs()) {
    check::state().scene = mechanism.name;
    f(mechanism);
  }
}

/// A standard normal number, by Box and Muller: the same on every machine.
inline double gaussian(check::Random& random) {
  const double u = 0.5 * (1 - random()), angle = std::numbers::pi * random();
  return std::sqrt(-2 * std::log(std::max(u, 1e-300))) * std::cos(angle);
}

/// Yaw turns e and u about z; tilt then turns u about e. The bars stay as drawn.
inline void turn_axis(Chain& chain, double yaw, double tilt) {
  const Mat3 about_z = rotation_z(yaw);
  chain.zero = about_z * chain.zero;
  const Mat3 turn = exp_so3(tilt * chain.zero) * about_z;
  chain.axis = turn * chain.axis;
  chain.pair_axis = turn * chain.pair_axis;
}

/// The robot as built: 0.1° (1σ) of yaw and tilt on every arm's axis.
inline Robot with_axis_errors(Robot robot, check::Random& random) {
  for (int i = 0; i < dof(robot.mobility); ++i) {
    const double yaw = degrees(0.1) * gaussian(random), tilt = degrees(0.1) * gaussian(random);
    turn_axis(robot.chain[i], yaw, tilt);
  }
  return robot;
}

}  // namespace mechanisms
