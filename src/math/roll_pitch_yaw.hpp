// Roll, pitch and yaw of machine controllers: R = Rz(yaw) Ry(pitch) Rx(roll).
#pragma once

#include <array>

#include "math/so3.hpp"

namespace truepose {
using RollPitchYaw = std::array<Real, 3>;  ///< rad

/// cos(pitch) below which roll and yaw are one angle.
inline constexpr Real kUpright = by_precision(1e-9, 1e-5);

Mat3 from_roll_pitch_yaw(const RollPitchYaw& angles);

/// Computes the angles of R next to `near`, turns included. (r, p, y) and (r + π, π - p, y + π)
/// give the same R; the nearer triple is returned. At pitch ±90° only roll and yaw together
/// are determined: roll stays as in `near`.
RollPitchYaw to_roll_pitch_yaw(const Mat3& R, const RollPitchYaw& near);
}  // namespace truepose
