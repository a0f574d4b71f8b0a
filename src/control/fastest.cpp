// Largest second derivative of readings within the motors' torque limits.
#include "control/fastest.hpp"

namespace truepose {
Outcome fastest(const Robot& robot, const Coordinates& x, Extended& most) {
  const int n = dof(robot.mobility);
  most.fill(0);
  Extended q_e;
  PoseRows H_x;
  Closure closure;
  DynamicModel model;
  const Pose pose = to_pose(robot.mobility, x);
  Outcome outcome = linearise(Level::ideal, robot, pose, q_e, H_x, nullptr);
  if (outcome) outcome = ikm(robot, pose, closure);
  if (outcome) outcome = dynamic_model(robot, closure, Coordinates{}, model);
  if (!outcome) return outcome;
  Coordinates size;
  bool limited = true;
  for (int i : range(n)) {
    size[i] = model.mass[i][i];
    limited = limited && robot.chain[i].torque_limit > 0;
  }
  const Ldlt mass(n, model.mass, size);
  if (!mass.regular()) return {Status::singular};
  for (int force = 0; force <= n && limited; ++force) {  // each motor, then gravity
    Coordinates acceleration{};
    const Real torque = force < n ? robot.chain[force].torque_limit : 1;
    for (int j : range(n))
      acceleration[j] = torque * (force < n ? model.k[force][j] : model.bias[j]);
    mass.solve(acceleration);
    for (int c : range(readings(robot))) {
      Real moves = 0;
      for (int j : range(n)) moves += H_x[c][j] * acceleration[j];
      most[c] += fabs(moves);
    }
  }
  return Outcome{};
}
}  // namespace truepose
