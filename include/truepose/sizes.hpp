// Maximum number of each part of a robot, and arrays of these sizes.
#pragma once

#include <array>

#include "truepose/truepose.h"

namespace truepose {
using Real = truepose_real;  ///< double, or single for machines without a double unit

inline constexpr int kMaxDof = TRUEPOSE_FREEDOMS;       ///< degrees of freedom n
inline constexpr int kMaxChains = TRUEPOSE_MOTORS;      ///< driven or not
inline constexpr int kMaxMotors = TRUEPOSE_MOTORS;      ///< they drive the first chains
inline constexpr int kMaxSensors = TRUEPOSE_SENSORS;    ///< redundant readings r
inline constexpr int kMaxReadings = TRUEPOSE_READINGS;  ///< extended positions: motors and r
inline constexpr int kMaxBodies = TRUEPOSE_BODIES;      ///< rigid bodies of the platform
inline constexpr int kMaxRods = 2 * kMaxChains;    ///< full level: two per spatial parallelogram
inline constexpr int kMaxBars = 2;                 ///< full level: lateral bars of the platform
inline constexpr int kMaxUnknowns = 6 + kMaxBars;  ///< full level: pose and one angle per bar
inline constexpr int kMaxAxes = TRUEPOSE_AXES;     ///< passive axes that carry the platform

static_assert(kMaxReadings == kMaxMotors + kMaxSensors);

using Coordinates = std::array<Real, kMaxDof>;    ///< of the platform: x, a twist, a small motion
using Joint = std::array<Real, kMaxMotors>;       ///< of the motors: q, torques
using Reading = std::array<Real, kMaxSensors>;    ///< anything of size r
using Extended = std::array<Real, kMaxReadings>;  ///< anything of size m + r
}  // namespace truepose
