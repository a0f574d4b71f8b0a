// The inverse kinematic model (IKM): motor positions from a pose.
#include "mechanism/ikm.hpp"

namespace truepose {
Outcome ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  Closure closure;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  if (!outcome) return outcome;
  q = closure.q();
  return within_limits(robot, closure.pose, q);
}
}  // namespace truepose
