// Angular rate that a gyroscope on the platform reads: ω = W(x) ẋ, in the platform's frame.
#pragma once

#include "mechanism/pose.hpp"
#include "truepose/status.hpp"

namespace truepose {
using GyroRows = Matrix<3, kMaxDof>;

/// Computes W, 3×n: the platform's angular velocity, in its own frame, per free rate. Column j is
/// Rᵀ a_j for a passive axis, else Rᵀ times the turn of a free twist. (A base that turns at ω_0,
/// such as a shank, adds Rᵀ ω_0.) @return unfinished, not_finite
Outcome gyro(const Robot& robot, const Coordinates& x, GyroRows& W);
}  // namespace truepose
