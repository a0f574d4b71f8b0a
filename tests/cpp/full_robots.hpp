// Robots with a full level, and their construction when no axis is exact.
#pragma once

#include "mechanisms.hpp"

namespace mechanisms {

inline constexpr Mobility kH4 = Mobility::schoenflies;

inline std::vector<Mechanism> with_pairs() { return {h4(), delta(), linear_delta()}; }

/// Calls f(mechanism) for every robot with a full level of its own.
void for_each_full(const std::function<void(const Mechanism&)>& f);

/// A standard normal number, by Box and Muller: the same on every machine.
double gaussian(check::Random& random);

/// Yaw turns e and u about z; tilt then turns u about e. The bars stay as drawn.
void turn_axis(Chain& chain, double yaw, double tilt);

/// The robot as built: 0.1° (1σ) of yaw and tilt on every arm's axis.
Robot with_axis_errors(Robot robot, check::Random& random);

}  // namespace mechanisms
