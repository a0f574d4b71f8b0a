// Consistency of the readings at rest, before a start-up test has any torque.
#include "safety/start_rest.hpp"

namespace truepose::start_detail {
Real rest_level(const Robot& robot, const SafetyLimits& limits, const Weighing& weighing,
                const Extended& q_e, Pose& pose, int& outside) {
  const int n = robot.motors;
  const int e = n + robot.r;
  for (int c = 0; c < n; ++c)
    if (limits.low[c] < limits.high[c] && !(q_e[c] >= limits.low[c] && q_e[c] <= limits.high[c])) {
      outside = c;
      return INFINITY;
    }
  pose = to_pose(robot.mobility, robot.home);
  if (fkm(robot, motors_of(robot, q_e), pose).status > Status::ok) return INFINITY;
  if (robot.r == 0 || !weighing) return 0;
  const Knowledge& known = *weighing.known;
  Extended beyond, noise{};
  Parity parity;
  Parasitic rest;
  Outcome outcome = parity.look(robot, pose, {});
  ParityGeometry geometry{};
  if (outcome)
    outcome = parity.geometry_at(robot, pose, known, weighing.work, geometry, beyond, rest);
  if (outcome) outcome = parity.locate(robot, {true, pose}, q_e, beyond);
  if (!outcome) return INFINITY;
  for (int c = 0; c < e; ++c) noise[c] = known.sigma[c] * known.sigma[c];
  ReadingCovariance V;
  parity.covariance(robot.r, noise, geometry, 1, V);
  if (!V.factor(robot.r)) return INFINITY;
  pose = parity.pose;
  return chi_squared(V, robot.r, parity.value);
}
}  // namespace truepose::start_detail
