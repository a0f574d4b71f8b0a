// Distance a loop has driven its motor since the motor's reading last changed.
//
// The frozen reading causes a phantom error, the motion of the setpoint since then. The loop drives
// the motor off by ∬ kp δ + kd dδ/dt; an error at which it may rest (friction, counts) drives
// nothing.
#pragma once

#include "math/real.hpp"

namespace truepose {
inline constexpr int kMostCounted = 1000;  ///< cycles without a change that are counted

/// rad or m, and s.
struct DrivenWay {
  Real from = 0;   ///< the setpoint when the reading changed last
  Real error = 0;  ///< phantom error beyond one at which the motor may rest,
  Real speed = 0;  ///< to which that drives the motor,
  Real way = 0;    ///< and the way
  int cycles = 0;  ///< with such an error

  /// One cycle. @param off  the law's error, where it is smaller; 0: unknown
  /// @param rests  error at which the motor may rest: friction may have held the opposite one
  /// before @return its way
  Real advance(Real period, Real kp, Real kd, Real setpoint, Real off, Real rests) {
    Real away = setpoint - from;
    if (off != 0 && !(off * away >= away * away)) away = off * away > 0 ? off : 0;
    const Real last = error;
    error = away - clamp(away, -rests, rests);
    speed = error == 0 ? 0 : speed + period * kp * error + kd * (error - last);
    cycles = error == 0 ? 0 : min(cycles + 1, kMostCounted);
    return way += period * speed;
  }
};
}  // namespace truepose
