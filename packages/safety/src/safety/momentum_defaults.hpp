// Settings of the momentum observer from a robot and its controller.
#pragma once

#include "control/limit_defaults.hpp"
#include "safety/momentum_observer.hpp"

namespace truepose {
/// Settings for a robot whose motors all have a torque limit, at home (all assumed):
///
///     period     4 ms, in whole control periods: a quarter of the cost of 1 ms
///     sigma      1 % of the torque limit, and the motor's own inertia times bandwidth² times one
///                reading's σ
///     give       1/kp
///
/// @return no_such_value and the motor without a torque limit or gain: no observer (period 0)
Outcome default_momentum(const Robot& robot, const ControlSettings& settings,
                         MomentumSettings& momentum);
}  // namespace truepose
