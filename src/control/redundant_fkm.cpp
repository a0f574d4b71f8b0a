// The redundant forward kinematic model: the pose of all readings, near a known one.
#include "control/redundant_fkm.hpp"

namespace truepose {
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Vec3& near_side, Pose& pose) {
  pose = Pose{};
  if (robot.mobility == Mobility::schoenflies) {
    pose.theta = measured(robot.sensor[0], q_e[robot.motors]);
    pose.R = rotation_z(pose.theta);
  }
  return fkm_closed(robot, motors_of(robot, q_e), pose.R, near_side, pose.D);
}

Outcome note_unfinished(const Robot& robot, const Pose& desired, const Pose& at, int steps,
                        PoseSearch& on, Pose& pose) {
  on.steps = steps;
  on.at = difference(robot.mobility, at, desired);
  pose = on.known ? moved(robot.mobility, desired, on.good) : at;
  if (++on.cycles < kSearchCycles) return {on.failed ? Status::not_converged : Status::ok};
  on = {};
  on.failed = true;
  return {Status::not_converged};
}

void note_found(const Robot& robot, const Pose& desired, const Pose& found, bool slow,
                PoseSearch& on) {
  on = {};
  on.known = true;
  on.slow = slow;
  on.good = on.at = difference(robot.mobility, found, desired);
}

Outcome search_pose(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
                    const Expected& desired, const Extended& q_e, Parasitic rest, PoseSearch& on,
                    Pose& found) {
  const Level level = level_of(robot);
  Expected at = desired;
  Extended white;
  const auto go_to = [&](const Pose& pose) {
    at.pose = pose;
    return linearise(level, robot, pose, at.q_e, at.H_x, nullptr, &rest);
  };
  if (on.slow || on.steps >= 0) {  // unless x_d is nearer
    const Real far = chi2(robot, known, C, q_e, desired.q_e, white);
    const Pose start = moved(robot.mobility, desired.pose, on.at);
    if (!go_to(start) || !(chi2(robot, known, C, q_e, at.q_e, white) < far))
      at = desired, on.steps = -1, on.restarted = false;
  }
  const auto cap = [&] { return on.restarted ? kEstimateIterations : kNearIterations; };
  Estimate result = search(level, robot, known, C, q_e, at, rest, max(on.steps, 0), cap());
  if (!result && !on.restarted && rest.most(true) > 0) {
    // The ideal level's, which is near the full level's and has bounded work.
    const Level start = is_mechanism(robot.mobility) ? level : Level::ideal;
    Pose pose = desired.pose;
    const Status motors = motors_pose(start, robot, motors_of(robot, q_e), pose, rest);
    const bool closed = motors == Status::ok || motors == Status::not_converged;
    result = {go_to(closed ? pose : desired.pose)};
    on.restarted = true;
    if (result) result = search(level, robot, known, C, q_e, at, rest, 0, cap());
  }
  const int left = rest.left;
  Outcome outcome = result.outcome;
  if (outcome) {
    found = at.pose;
    note_found(robot, desired.pose, found, result.iterations > kQuickSteps, on);
  } else if (rest.most(true) < 1 && result.iterations < kEstimateIterations) {
    outcome = note_unfinished(robot, desired.pose, at.pose, result.iterations, on, found);
  } else {
    on = {};
    on.failed = true;
  }
  on.left = left;
  return outcome;
}

Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Pose& near, Parasitic nearby,
                      PoseSearch& on, Pose& pose) {
  if (in_closed_form(robot)) return redundant_fkm(robot, q_e, near.D, pose);
  if (redundancy(robot) == 0) return {Status::not_measured};
  if (!all_finite(q_e, readings(robot))) return {Status::not_finite};
  constexpr Real kSigma = by_precision(1e-6, 1e-3);  // rad or m: sets when a search ends
  Knowledge alike;
  alike.sigma.fill(kSigma);
  for (int k : range(robot.r))
    alike.sigma[robot.motors + k] = kSigma / sqrt(robot.sensor[k].weight);
  ReadingCovariance C;
  Expected at{near, {}, {}};
  Outcome outcome = reading_covariance(robot, alike, nullptr, nullptr, C);
  if (outcome) outcome = linearise(level_of(robot), robot, near, at.q_e, at.H_x, nullptr, &nearby);
  return outcome ? search_pose(robot, alike, C, at, q_e, nearby, on, pose) : outcome;
}

Outcome redundant_fkm(const Robot& robot, const Extended& q_e, Coordinates& x) {
  if (!robot.finished) return {Status::unfinished};
  Pose pose;
  PoseSearch on;
  const Outcome outcome =
      redundant_fkm(robot, q_e, to_pose(robot.mobility, robot.home), {}, on, pose);
  if (outcome) x = to_coordinates(robot.mobility, pose);
  return outcome;
}
}  // namespace truepose
