// Control laws: motor errors from readings, the paper's three and two that weigh the readings.
#include "control/law.hpp"

namespace truepose {
namespace {
/// As linearise(), at the reference's pose.
Outcome linearise(const Robot& robot, const Reference& reference, Extended& q_e, PoseRows& H_x,
                  Real* H_xi, Parasitic& rest) {
  if (robot.rod_by_rod())
    return truepose::linearise(Level::full, robot, reference.closure.pose, q_e, H_x, H_xi, &rest);
  pose_rows(robot, reference.jacobians, reference.jr, H_x);
  if (H_xi) parameter_jacobian(robot, reference.closure, H_xi);
  return {};
}

/// The same with the weights at that pose: cached, or fresh beyond their validity radius.
/// @return singular where the motors alone do not determine the pose
Outcome linearise_kept(const Robot& robot, const Weighing& weighing, const Reference& reference,
                       Extended& q_e, PoseRows& H_x, Parasitic& rest, CachedFusion& at) {
  const int n = dof(robot.mobility);
  const Knowledge& known = *weighing.known;
  CachedGain& kept = *weighing.kept;
  Real *H_xi = weighing.work, *B = H_xi + readings(robot) * parameter_count(robot);
  const std::uint64_t mark = fingerprint(robot, known);
  const bool holds = kept.of == mark && kept.way(n, q_e) <= kept.reach;
  const Outcome outcome = linearise(robot, reference, q_e, H_x, holds ? nullptr : H_xi, rest);
  if (!outcome) return outcome;
  if (!at.set_jacobians(robot, H_x)) return {Status::singular};
  if (holds) return at.weigh(robot, known, kept);
  return refresh(robot, known, mark, q_e, H_x, H_xi, B, kept, at);
}

/// Weighted TEJ at the reference's pose: M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹, C at that pose or from the cache.
Outcome weigh(const Robot& robot, const Weighing& weighing, Parasitic& rest, Reference& reference) {
  if (!weighing) return {Status::not_measured};
  PoseRows H_x;
  if (weighing.kept && !overdriven(robot)) {
    CachedFusion at;
    const Outcome outcome =
        linearise_kept(robot, weighing, reference, reference.q_e, H_x, rest, at);
    if (outcome) at.tej(robot, H_x, reference.tej);
    if (outcome.status != Status::singular) return outcome;
  }
  ReadingCovariance C;
  Fusion fusion;
  Real *H_xi = weighing.work, *B = H_xi + readings(robot) * parameter_count(robot);
  Outcome outcome = linearise(robot, reference, reference.q_e, H_x, H_xi, rest);
  if (outcome) outcome = reading_covariance(robot, *weighing.known, H_xi, B, C);
  if (outcome) outcome = fuse(robot, *weighing.known, C, H_x, fusion);
  if (outcome) weighted_tej(robot, H_x, fusion, reference.tej);
  return outcome;
}

/// TEJ of a law of all readings.
Outcome map_of(const Robot& robot, Law law, const Weighing& weighing, Parasitic& rest,
               Reference& reference) {
  if (law == Law::weighted) return weigh(robot, weighing, rest, reference);
  tej(robot, reference.jacobians, reference.jr, reference.M, reference.tej);
  return {};
}

/// x̂ with cached weights: it solves HᵀC⁻¹(q_e - h) = 0 with the weights of its own pose. Far
/// from the reference they are computed anew.
Outcome find_kept(const Robot& robot, const Weighing& weighing, const Reference& reference,
                  const Extended& q_e, Pose& found, Parasitic rest) {
  const int n = dof(robot.mobility);
  if (!weighing) return {Status::not_measured};
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
    outcome = linearise(level_of(robot), robot, pose, expected, H_x, nullptr, &rest);
    if (outcome && !at.set_jacobians(robot, H_x)) break;
    if (outcome) outcome = at.weigh(robot, known, *weighing.kept);
  }
  found = reference.closure.pose;
  return estimate(level_of(robot), robot, known, q_e, found, weighing.work).outcome;
}

}  // namespace

Outcome found_pose(const Robot& robot, Law law, const Pose& desired, const Extended& q_e,
                   Pose& found, const Weighing& weighing, const Parasitic& nearby) {
  if (law == Law::cartesian) return redundant_fkm(robot, q_e, desired, nearby, found);
  if (!weighing) return {Status::not_measured};
  return find(robot, *weighing.known, weighing.work, desired, q_e, found, nearby);
}

Outcome refer(const Robot& robot, Law law, const Coordinates& x_d, Reference& reference, Real band,
              const Weighing& weighing, Parasitic* nearby) {
  if (redundancy(robot) == 0 && properties(law).sensed) return {Status::not_measured};
  Parasitic unknown;
  Parasitic& rest = nearby ? *nearby : unknown;
  Reading r;
  const Outcome regular = kinematics_at(robot, to_pose(robot.mobility, x_d), band,
                                        reference.closure, reference.jacobians, r, reference.jr);
  Outcome outcome = regular;
  if (outcome) outcome = within_limits(robot, reference.closure.pose, reference.closure.q());
  // The motors would have to pass through a singularity to reach another mode.
  const bool modes_meet = regular.status == Status::near_singular && regular.chain < 0;
  if (outcome && !modes_meet && other_mode(robot.assembly_sign, reference.jacobians.sign))
    outcome = {Status::branch_lost};
  if (!outcome) return outcome;
  extend(robot, reference.closure.q(), r, reference.q_e);
  reference.pose = reference.closure.pose;
  if (robot.rod_by_rod() && !is_mechanism(robot.mobility)) {  // whose one level is closed already
    outcome = extended(Level::full, robot, reference.pose, reference.q_e, &rest);
    if (outcome) outcome = within_limits(robot, motors_of(robot, reference.q_e));
    // The ideal model's pose of q_e is compared with its pose of q_de: at x_d both agree.
    if (outcome && properties(law).corrects == Corrects::pose && !properties(law).weighs)
      outcome = found_pose(robot, law, reference.closure.pose, reference.q_e, reference.pose,
                           weighing, rest);
    if (!outcome) return outcome;
  }
  if (properties(law).corrects == Corrects::readings)
    outcome = map_of(robot, law, weighing, rest, reference);
  return outcome ? regular : outcome;
}

Outcome motor_error(const Robot& robot, Law law, const Reference& reference, const Extended& q_e,
                    Joint& error, Pose& found, const Weighing& weighing, const Parasitic& nearby) {
  const int m = robot.motors;
  const Corrects corrects = properties(law).corrects;
  if (corrects == Corrects::pose) {
    const Outcome outcome =
        properties(law).weighs && weighing.kept && !overdriven(robot)
            ? find_kept(robot, weighing, reference, q_e, found, nearby)
            : found_pose(robot, law, reference.closure.pose, q_e, found, weighing, nearby);
    if (outcome)
      error = reference.jacobians.joint_rate(difference(robot.mobility, reference.pose, found));
    return outcome;
  }
  std::array<Real, kMaxReadings> e_qe;
  for (int i = 0; i < m; ++i) e_qe[i] = reference.q_e[i] - q_e[i];
  if (corrects == Corrects::motors) {
    for (int i = 0; i < m; ++i) error[i] = e_qe[i];
    // Without what no motion of the platform corrects, against which the motors would only strain.
    if (overdriven(robot))
      error = reference.jacobians.joint_rate(pose_rate(reference.jacobians, error));
  } else {
    for (int k = m; k < m + robot.r; ++k) e_qe[k] = reference.q_e[k] - q_e[k];
    for (int i = 0; i < m; ++i) {
      error[i] = 0;
      for (int c = 0; c < m + robot.r; ++c) error[i] += reference.tej[i][c] * e_qe[c];
    }
  }
  return {};
}

Outcome motor_error(const Robot& robot, Law law, const Coordinates& x_d, const Extended& q_e,
                    Joint& error, Real band, const Weighing& weighing, Parasitic* kept,
                    ServoCycle* cycle) {
  const int n = dof(robot.mobility), m = robot.motors;
  const bool alone = properties(law).corrects == Corrects::motors;
  if (!all_finite(q_e, alone ? m : readings(robot)) || !all_finite(x_d, n))
    return {Status::not_finite};
  Reference reference;
  Parasitic unknown;
  Parasitic& nearby = kept ? *kept : unknown;
  const Outcome regular = refer(robot, law, x_d, reference, band, weighing, &nearby);
  if (!regular) return regular;
  Pose found;
  Joint e{};
  Outcome outcome = motor_error(robot, law, reference, q_e, e, found, weighing, nearby);
  if (outcome && !all_finite(e, m)) outcome = {Status::not_finite};
  if (!outcome) return outcome;
  error = e;
  if (cycle == nullptr) return regular;
  const Corrects corrects = properties(law).corrects;
  *cycle = {};
  cycle->x = corrects == Corrects::pose ? to_coordinates(robot.mobility, found) : x_d;
  cycle->error = e;
  for (int i = 0; i < n; ++i) std::copy_n(reference.jacobians.J[i].begin(), m, cycle->J[i].begin());
  for (int i = 0; i < m; ++i) {
    cycle->q_d[i] = reference.q_e[i];
    if (corrects == Corrects::readings)
      std::copy_n(reference.tej[i].begin(), m + robot.r, cycle->tej[i].begin());
  }
  return regular;
}
}  // namespace truepose
