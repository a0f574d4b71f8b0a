// Largest second derivative of readings within the motors' torque limits.
#include "control/fastest.hpp"

namespace truepose {
Outcome fastest(const Robot& robot, const Coordinates& x, Extended& most) {
  Joint torque{};
  bool limited = true;
  for (int i : range(robot.motors)) {
    torque[i] = robot.chain[i].torque_limit;
    limited = limited && torque[i] > 0;
  }
  return fastest_under(robot, x, limited ? torque : Joint{}, limited, most);
}

Outcome fastest_under(const Robot& robot, const Coordinates& x, const Joint& torque, Real gravity,
                      Extended& most) {
  const int n = dof(robot.mobility), m = robot.motors;
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
  for (int i : range(n)) size[i] = model.mass[i][i];
  const Ldlt mass(n, model.mass, size);
  if (!mass.regular()) return {Status::singular};
  for (int force : range(m + 1)) {  // each motor, then gravity
    Coordinates acceleration{};
    for (int j : range(n))
      acceleration[j] = force < m ? torque[force] * model.k[force][j] : gravity * model.bias[j];
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
