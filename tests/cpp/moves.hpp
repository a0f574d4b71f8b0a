// Straight moves of a simulated robot.
#pragma once

#include <cmath>

#include "mechanisms.hpp"
#include "simulation/simulate.hpp"

namespace mechanisms {

/// Runs a straight quintic move of `duration`, s, from rest, and then holds its end; calls
/// write(sample) once per period, end included.
inline Outcome run_move(Loop&& loop, Mobility mobility, const Coordinates& from,
                        const Coordinates& to, double duration, double hold, const Write& write) {
  constexpr double kPeriod = 1e-3;  // of ControlSettings
  return loop.follow(
      int(std::lround((duration + hold) / kPeriod)), 2,
      [&](double k) { return quintic(mobility, from, to, duration, k * kPeriod); }, write);
}

}  // namespace mechanisms
