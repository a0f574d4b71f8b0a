// The redundant forward kinematic model: the pose of all readings, near a known one.
#include "control/redundant_fkm.hpp"

namespace truepose {
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Vec3& near_side, Pose& pose) {
  if (!robot.finished) return {Status::unfinished};
  const bool turns = robot.mobility == Mobility::schoenflies;
  if (!turns && robot.mobility != Mobility::translation) return {Status::not_measured};
  pose = Pose{};
  if (turns) {
    int k = 0;
    while (k < robot.r && !properties(robot.sensor[k].kind).is_theta) ++k;
    if (k == robot.r) return {Status::not_measured};
    pose.theta = measured(robot.sensor[k], q_e[robot.motors + k]);
    pose.R = rotation_z(pose.theta);
  }
  return fkm_closed(robot, motors_of(robot, q_e), pose.R, near_side, pose.D);
}

Outcome find(const Robot& robot, const Knowledge& known, Real* work, const Pose& desired,
             const Extended& q_e, Pose& found, Parasitic rest) {
  const Level level = level_of(robot);
  found = desired;
  const Outcome outcome =
      estimate_from(level, robot, known, q_e, found, work, rest, kNearIterations).outcome;
  return outcome ? outcome : estimate(level, robot, known, q_e, found, work).outcome;
}

Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Pose& near,
                      const Parasitic& nearby, Pose& pose) {
  if (in_closed_form(robot)) return redundant_fkm(robot, q_e, near.D, pose);
  if (redundancy(robot) == 0) return {Status::not_measured};
  constexpr Real kSigma = by_precision(1e-6, 1e-3);  // rad or m: sets when a search ends
  Knowledge alike;
  alike.sigma.fill(kSigma);
  for (int k = 0; k < robot.r; ++k)
    alike.sigma[robot.motors + k] = kSigma / std::sqrt(robot.sensor[k].weight);
  return find(robot, alike, nullptr, near, q_e, pose, nearby);
}

Outcome redundant_fkm(const Robot& robot, const Extended& q_e, Coordinates& x) {
  if (!robot.finished) return {Status::unfinished};
  Pose pose;
  const Outcome outcome = redundant_fkm(robot, q_e, to_pose(robot.mobility, robot.home), {}, pose);
  if (outcome) x = to_coordinates(robot.mobility, pose);
  return outcome;
}
}  // namespace truepose
