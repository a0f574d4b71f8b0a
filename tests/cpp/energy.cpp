#include "energy.hpp"

namespace mechanisms {
Outcome energy(const Robot& robot, const Pose& pose, const Coordinates& rate, Energy& result) {
  Closure closure;
  DynamicModel model;
  Outcome outcome = ikm(robot, pose, closure, false);
  if (outcome) outcome = dynamic_model(robot, closure, rate, model);
  if (!outcome) return outcome;
  result = {};
  const int n = dof(robot.mobility);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) result.kinetic += 0.5 * rate[i] * model.mass[i][j] * rate[j];
  for (int i = 0; i < robot.motors; ++i) {
    const Chain& chain = robot.chain[i];
    const Vec3 B = chain.base + closure.chain[i].p, A = B - closure.chain[i].v;
    const Vec3 arm = chain.actuator == Actuator::revolute ? Vec3(0.5 * (chain.base + B)) : B;
    result.potential -= robot.gravity.dot(chain.rod_mass / 2 * (A + B) + chain.arm_mass * arm);
  }
  for (int i = 0; i < robot.bodies; ++i)
    result.potential -=
        robot.body[i].mass *
        robot.gravity.dot(closure.placed().D + closure.placed().R * robot.body[i].pivot +
                          robot.body[i].anchor);
  return outcome;
}
}  // namespace mechanisms
