#include "control/law.hpp"

namespace truepose {
Outcome linearise(const Robot& robot, const Reference& reference, Extended& q_e, PoseRows& H_x,
                  Real* H_xi, Parasitic& rest) {
  if (robot.rod_by_rod())
    return linearise_full(robot, reference.closure.pose, q_e, H_x, H_xi, &rest);
  pose_rows(robot, reference.jacobians, reference.jr, H_x);
  if (H_xi) parameter_jacobian(robot, reference.closure, H_xi);
  return {};
}

Outcome linearise_kept(const Robot& robot, const Weighing& weighing, const Reference& reference,
                       Extended& q_e, PoseRows& H_x, Parasitic& rest, CachedFusion& at) {
  const int n = dof(robot.mobility);
  const Knowledge& known = *weighing.known;
  CachedGain& kept = *weighing.kept;
  Real *H_xi = weighing.work, *B = H_xi + (n + robot.r) * parameter_count(robot);
  const std::uint64_t mark = fingerprint(robot, known);
  const bool holds = kept.of == mark && kept.way(n, q_e) <= kept.reach;
  const Outcome outcome = linearise(robot, reference, q_e, H_x, holds ? nullptr : H_xi, rest);
  if (!outcome) return outcome;
  if (!at.set_jacobians(robot, H_x)) return {Status::singular, -1};
  if (holds) return at.weigh(robot, known, kept);
  return refresh(robot, known, mark, q_e, H_x, H_xi, B, kept, at);
}

Outcome weigh(const Robot& robot, const Weighing& weighing, Parasitic& rest, Reference& reference) {
  if (!weighing) return {Status::not_measured, -1};
  const int n = dof(robot.mobility);
  PoseRows H_x;
  if (weighing.kept) {
    CachedFusion at;
    const Outcome outcome =
        linearise_kept(robot, weighing, reference, reference.q_e, H_x, rest, at);
    if (outcome) at.tej(robot, H_x, reference.tej);
    if (outcome.status != Status::singular) return outcome;
  }
  ReadingCovariance C;
  Fusion fusion;
  Real *H_xi = weighing.work, *B = H_xi + (n + robot.r) * parameter_count(robot);
  Outcome outcome = linearise(robot, reference, reference.q_e, H_x, H_xi, rest);
  if (outcome) outcome = reading_covariance(robot, *weighing.known, H_xi, B, C);
  if (outcome) outcome = fuse(robot, *weighing.known, C, H_x, fusion);
  if (outcome) weighted_tej(robot, H_x, fusion, reference.tej);
  return outcome;
}

Outcome refer_full(const Robot& robot, Parasitic& rest, Reference& reference) {
  const Outcome outcome = extended_full(robot, reference.closure.pose, reference.q_e, &rest);
  return outcome ? within_limits(robot, motors_of(robot, reference.q_e)) : outcome;
}

Outcome map_of(const Robot& robot, Law law, const Weighing& weighing, Parasitic& rest,
               Reference& reference) {
  if (law == Law::weighted) return weigh(robot, weighing, rest, reference);
  tej(robot, reference.jacobians, reference.jr, reference.M, reference.tej);
  return {};
}

Outcome find_kept(const Robot& robot, const Weighing& weighing, const Reference& reference,
                  const Extended& q_e, Pose& found, Parasitic rest) {
  const int n = dof(robot.mobility);
  if (!weighing) return {Status::not_measured, -1};
  const Knowledge& known = *weighing.known;
  CachedFusion at;
  PoseRows H_x;
  Extended expected = reference.q_e;
  Pose pose = reference.closure.pose;
  Outcome outcome = linearise_kept(robot, weighing, reference, expected, H_x, rest, at);
  Real last = INFINITY;
  for (int left = kNearIterations; outcome; --left) {
    Extended e{};
    Coordinates step{};
    innovation(robot, q_e, expected, e);
    const Real chi2 = at.step(robot, e, step);
    Real size = 0;
    for (int i = 0; i < n; ++i) size = std::max(size, step[i] * step[i] / at.variance[i]);
    if (!all_finite(step, n) || !(chi2 < INFINITY)) break;
    found = pose = moved(robot.mobility, pose, step);
    if (is_last(size, last, chi2, n + robot.r)) return outcome;
    if (left == 0) break;
    last = size;
    outcome = linearise(level_of(robot), robot, pose, expected, H_x, nullptr, rest);
    if (outcome && !at.set_jacobians(robot, H_x)) break;
    if (outcome) outcome = at.weigh(robot, known, *weighing.kept);
  }
  found = reference.closure.pose;
  return estimate(level_of(robot), robot, known, q_e, found, weighing.work).outcome;
}

Outcome found_pose(const Robot& robot, Law law, const Pose& desired, const Extended& q_e,
                   Pose& found, const Weighing& weighing, const Parasitic& nearby) {
  if (law == Law::cartesian) return redundant_fkm(robot, q_e, desired, nearby, found);
  if (!weighing) return {Status::not_measured, -1};
  return find(robot, *weighing.known, weighing.work, desired, q_e, found, nearby);
}
}  // namespace truepose
