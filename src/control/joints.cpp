// Joint states from motor states, and motor commands from joint commands, on passive axes.
#include "control/joints.hpp"

namespace truepose {
namespace {
/// The joints' values as coordinates.
Coordinates free(const Joint& of) {
  Coordinates values;
  copy_first(kMaxDof, of, values);
  return values;
}
}  // namespace

Outcome joint_state(const Robot& robot, const AxisState& motors, int cap, AxisState& joints) {
  Coordinates x = free(joints.position);
  const Outcome found = fkm(Level::ideal, robot, motors.position, x, cap);
  if (!found) return found;
  const int n = dof(robot.mobility);
  const int m = robot.motors;
  if (!all_finite(motors.velocity, m) || !all_finite(motors.torque, m)) return {Status::not_finite};
  Closure closure;
  Jacobians at;
  const Outcome outcome = jacobian_at(robot, to_pose(robot.mobility, x), closure, at, false);
  if (!outcome) return outcome;
  joints = {};
  copy_first(n, x, joints.position);
  for (int i : range(n))
    for (int j : range(m)) {
      joints.velocity[i] += at.J[i][j] * motors.velocity[j];
      joints.torque[i] += at.jx[j][i] / at.jq[j] * motors.torque[j];
    }
  return outcome;
}

Outcome motor_command(const Robot& robot, const AxisState& motors, const AxisState& joints,
                      const AxisCommand& wanted, AxisCommand& given) {
  const int n = dof(robot.mobility);
  for (const Joint* values : {&wanted.state.position, &wanted.state.velocity, &wanted.state.torque,
                              &wanted.kp, &wanted.kd, &joints.position, &joints.velocity})
    if (!all_finite(*values, n)) return {Status::not_finite};
  for (const Joint* values : {&motors.position, &motors.velocity})
    if (!all_finite(*values, robot.motors)) return {Status::not_finite};
  const Pose desired = to_pose(robot.mobility, free(wanted.state.position)),
             now = to_pose(robot.mobility, free(joints.position));
  Closure closure;
  Jacobians at;
  AxisCommand result;
  Outcome outcome = command(Level::ideal, robot, desired, result.state.position);
  if (outcome) outcome = jacobian_at(robot, desired, closure, at, false);
  if (outcome) result.state.velocity = at.joint_rate(free(wanted.state.velocity));
  if (outcome) outcome = jacobian_at(robot, now, closure, at, false);
  if (!outcome) return outcome;
  const Coordinates away = difference(robot.mobility, desired, now);
  for (int j : range(robot.motors)) {
    for (int i : range(n)) {
      const Real J = at.J[i][j];
      result.kp[j] += J * J * wanted.kp[i];
      result.kd[j] += J * J * wanted.kd[i];
      result.state.torque[j] +=
          J * (wanted.state.torque[i] + wanted.kp[i] * away[i] +
               wanted.kd[i] * (wanted.state.velocity[i] - joints.velocity[i]));
    }
    result.state.torque[j] -= result.kp[j] * (result.state.position[j] - motors.position[j]) +
                              result.kd[j] * (result.state.velocity[j] - motors.velocity[j]);
  }
  given = result;
  return outcome;
}
}  // namespace truepose
