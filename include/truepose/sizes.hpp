// Maximum number of each part of a robot, and arrays of these sizes.
#pragma once

#include <array>

#include "truepose/truepose.h"

namespace truepose {
using Real = truepose_real;  ///< double, or single for machines without a double unit

inline constexpr int kMaxDof = 6;        ///< degrees of freedom n
inline constexpr int kMaxChains = 6;     ///< driven or not
inline constexpr int kMaxMotors = 6;     ///< they drive the first chains
inline constexpr int kMaxSensors = 12;   ///< redundant readings r
inline constexpr int kMaxReadings = 16;  ///< extended positions, motors and r: with six, r <= 10
inline constexpr int kMaxBodies = 8;     ///< rigid bodies of the platform
inline constexpr int kMaxRods = 12;      ///< full level: two per spatial parallelogram
inline constexpr int kMaxBars = 2;       ///< full level: lateral bars of the platform
inline constexpr int kMaxUnknowns = 8;   ///< full level: pose and one angle per bar
inline constexpr int kMaxAxes = 3;       ///< passive axes that carry the platform

static_assert(kMaxReadings <= kMaxMotors + kMaxSensors && kMaxRods == 2 * kMaxChains &&
              kMaxUnknowns == 6 + kMaxBars);

using Coordinates = std::array<Real, kMaxDof>;    ///< of the platform: x, a twist, a small motion
using Joint = std::array<Real, kMaxMotors>;       ///< of the motors: q, torques
using Reading = std::array<Real, kMaxSensors>;    ///< anything of size r
using Extended = std::array<Real, kMaxReadings>;  ///< anything of size n + r
}  // namespace truepose
