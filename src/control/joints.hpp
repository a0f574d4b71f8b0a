// Joint states from motor states, and motor commands from joint commands, on passive axes.
//
// x = FKM(q), ẋ = J q̇, joint torque Kᵀτ; conversely q = IKM(x), q̇ = K ẋ, motor torque Jᵀτ, with
// torque times rate the same on both sides. For other mobilities joints are the free coordinates.
#pragma once

#include "control/command.hpp"
#include "mechanism/fkm.hpp"

namespace truepose {
/// State of motors, or of joints in the first n: rad or m, per s, N·m or N.
struct AxisState {
  Joint position{}, velocity{}, torque{};
};
/// Command to a drive: torque + kp (position - measured) + kd (velocity - measured).
struct AxisCommand {
  AxisState state;
  Joint kp{}, kd{};
};

/// Joint state from motor state. @param joints  in: position guess; out
/// @return as fkm() and jacobian()
Outcome joint_state(const Robot& robot, const AxisState& motors, int cap, AxisState& joints);

/// Motor commands by which the drives together act on the joints as the joint command says: exactly
/// at the present state, and near it by the diagonals of Jᵀ diag(kp) J and Jᵀ diag(kd) J.
/// @param motors, joints  as of joint_state()
/// @return as command() of the joint command's position
Outcome motor_command(const Robot& robot, const AxisState& motors, const AxisState& joints,
                      const AxisCommand& wanted, AxisCommand& given);
}  // namespace truepose
