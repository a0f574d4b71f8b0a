// Control laws: motor errors from readings, the paper's three and two that weigh the readings.
#include "control/law.hpp"

namespace truepose {
namespace {
/// H_x at x_d, at the robot's level with q_de, and H_ξ unless cached weights are valid there.
/// @param fresh  take no cached weights
Outcome linearise(const Robot& robot, const Weighing& weighing, bool fresh, Reference& reference) {
  const bool caches = weighing.kept && !overdriven(robot);
  reference.mark = caches ? fingerprint(robot, *weighing.known) : 0;
  reference.cached =
      caches && !fresh && weighing.kept->of == reference.mark &&
      weighing.kept->way(dof(robot.mobility), reference.closure.q()) <= weighing.kept->reach;
  Real* H_xi = reference.cached ? nullptr : weighing.work;
  if (robot.rod_by_rod())
    return truepose::linearise(Level::full, robot, reference.closure.pose, reference.q_e,
                               reference.H_x, H_xi, &reference.rest);
  pose_rows(robot, reference.jacobians, reference.jr, reference.H_x);
  if (H_xi) parameter_jacobian(robot, reference.closure, H_xi);
  return {};
}

/// Work space behind H_ξ.
Real* behind(const Robot& robot, const Weighing& weighing) {
  return weighing.work + readings(robot) * parameter_count(robot);
}

/// C at x_d.
Outcome fresh_weights(const Robot& robot, const Weighing& weighing, Reference& reference,
                      ReadingCovariance& C) {
  Outcome outcome;
  if (reference.cached) outcome = linearise(robot, weighing, true, reference);
  if (!outcome) return outcome;
  return reading_covariance(robot, *weighing.known, weighing.work, behind(robot, weighing), C);
}

/// The cached weights, refreshed at x_d beyond their validity radius.
/// @return singular where the motors alone do not determine the pose
Outcome cached_weights(const Robot& robot, const Weighing& weighing, const Reference& reference,
                       CachedFusion& at) {
  if (!at.set_jacobians(robot, reference.H_x)) return {Status::singular};
  if (reference.cached) return at.weigh(robot, *weighing.known, *weighing.kept);
  return refresh(robot, *weighing.known, reference.mark, reference.closure.q(), reference.H_x,
                 weighing.work, behind(robot, weighing), *weighing.kept, at);
}

/// Weighted TEJ at x_d: M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹, C at that pose or from the cache.
Outcome weigh(const Robot& robot, const Weighing& weighing, Reference& reference) {
  if (reference.mark) {
    CachedFusion at;
    const Outcome outcome = cached_weights(robot, weighing, reference, at);
    if (outcome) at.tej(robot, reference.H_x, reference.tej);
    if (outcome.status != Status::singular) return outcome;
  }
  ReadingCovariance C;
  Fusion fusion;
  Outcome outcome = fresh_weights(robot, weighing, reference, C);
  if (outcome) outcome = fuse(robot, *weighing.known, C, reference.H_x, fusion);
  if (outcome) weighted_tej(robot, reference.H_x, fusion, reference.tej);
  return outcome;
}

/// x̂ with cached weights: it solves HᵀC⁻¹(q_e - h) = 0 with the weights of its own pose.
/// @param rest  in: at x_d; out: steps left
/// @return not_converged far from x_d
Outcome find_by_cache(const Robot& robot, const Weighing& weighing, const Reference& reference,
                      const Extended& q_e, Parasitic& rest, Pose& pose) {
  const int n = dof(robot.mobility);
  CachedFusion at;
  PoseRows H_x;
  Extended expected = reference.q_e;
  pose = reference.closure.pose;
  const bool counted = rest.left != kUncounted;
  Outcome outcome = cached_weights(robot, weighing, reference, at);
  Real last = INFINITY;
  for (int left = kNearIterations; outcome; --left) {
    Extended e{};
    Coordinates step{};
    innovation(robot, q_e, expected, e);
    const Real chi2 = at.step(robot, e, step);
    Real size = 0;
    for (int i : range(n)) size = max(size, step[i] * step[i] / at.variance[i]);
    if (!all_finite(step, n) || !(chi2 < INFINITY)) break;
    pose = moved(robot.mobility, pose, step);
    if (is_last(size, last, chi2, n + robot.r) || is_late(size, kNearIterations - left, counted))
      return outcome;
    if (left == 0) break;
    last = size;
    outcome = linearise(level_of(robot), robot, pose, expected, H_x, nullptr, &rest);
    if (outcome && !at.set_jacobians(robot, H_x)) break;
    if (outcome) outcome = at.weigh(robot, *weighing.known, *weighing.kept);
  }
  return {Status::not_converged};
}

/// x̂ of the estimated law.
Outcome search_pose(const Robot& robot, const Weighing& weighing, Reference reference,
                    const Extended& q_e, PoseSearch& on, Pose& found) {
  if (reference.mark && on.steps < 0) {
    const Pose& desired = reference.closure.pose;
    Outcome near = find_by_cache(robot, weighing, reference, q_e, reference.rest, found);
    const int left = reference.rest.left;
    if (near) note_found(robot, desired, found, false, on);
    // The next cycle searches with fresh weights.
    else if (left != kUncounted)
      near = note_unfinished(robot, desired, found, 0, on, found);
    on.left = left;
    if (near || left != kUncounted) return near;
  }
  ReadingCovariance C;
  const Outcome outcome = fresh_weights(robot, weighing, reference, C);
  const Expected desired{reference.closure.pose, reference.q_e, reference.H_x};
  return outcome ? search_pose(robot, *weighing.known, C, desired, q_e, reference.rest, on, found)
                 : outcome;
}

/// x̂ of a law of the pose; not inlined: its stack is none of the other laws'. @param on  as of
/// `search_pose`
[[gnu::noinline]] Outcome found_pose(const Robot& robot, Law law, const Weighing& weighing,
                                     const Reference& reference, const Extended& q_e,
                                     PoseSearch& on, Pose& found) {
  if (law == Law::cartesian)
    return redundant_fkm(robot, q_e, reference.closure.pose, reference.rest, on, found);
  return search_pose(robot, weighing, reference, q_e, on, found);
}

/// M⁺ of the reference; not inlined: M leaves the stack with it.
[[gnu::noinline]] void tej_at(const Robot& robot, Reference& reference) {
  ExtendedColumns M;
  tej(robot, reference.jacobians, reference.jr, M, reference.tej);
}
}  // namespace

Outcome refer(const Robot& robot, Law law, const Coordinates& x_d, Reference& reference, Real band,
              const Weighing& weighing, Parasitic* nearby) {
  const LawProperties& of = properties(law);
  if ((redundancy(robot) == 0 && of.sensed) || (of.weighs && !weighing))
    return {Status::not_measured};
  reference.rest = nearby ? *nearby : Parasitic{};
  Reading r;
  const Outcome regular =
      kinematics_at(robot, to_pose(robot.mobility, x_d), band, reference.closure,
                    reference.jacobians, r, reference.jr, &reference.rest);
  Outcome outcome = regular;
  if (outcome) outcome = within_limits(robot, reference.closure.pose, reference.closure.q());
  // The motors would have to pass through a singularity to reach another mode.
  const bool modes_meet = regular.status == Status::near_singular && regular.chain < 0;
  if (outcome && !modes_meet && other_mode(robot.assembly_sign, reference.jacobians.sign))
    outcome = {Status::branch_lost};
  if (!outcome) return outcome;
  extend(robot, reference.closure.q(), r, reference.q_e);
  reference.pose = reference.closure.pose;
  // A described mechanism's one level is closed already.
  const bool full = robot.rod_by_rod() && !is_mechanism(robot.mobility);
  if (of.weighs)
    outcome = linearise(robot, weighing, false, reference);
  else if (full)
    outcome = extended(Level::full, robot, reference.pose, reference.q_e, &reference.rest);
  if (outcome && full) outcome = within_limits(robot, motors_of(robot, reference.q_e));
  // The ideal model's pose of q_e is compared with its pose of q_de: at x_d both agree.
  if (outcome && full && law == Law::cartesian && in_closed_form(robot))
    outcome = redundant_fkm(robot, reference.q_e, reference.closure.pose.D, reference.pose);
  if (!outcome) return outcome;
  if (nearby) *nearby = reference.rest;
  if (law == Law::weighted)
    outcome = weigh(robot, weighing, reference);
  else if (of.corrects == Corrects::readings) {
    tej_at(robot, reference);
  }
  return outcome ? regular : outcome;
}

Outcome motor_error(const Robot& robot, Law law, const Reference& reference, const Extended& q_e,
                    Joint& error, Pose& found, const Weighing& weighing, PoseSearch* search) {
  const int m = robot.motors;
  const Corrects corrects = properties(law).corrects;
  if (corrects == Corrects::pose) {
    PoseSearch alone;
    const Outcome outcome =
        found_pose(robot, law, weighing, reference, q_e, search ? *search : alone, found);
    if (outcome)
      error = reference.jacobians.joint_rate(difference(robot.mobility, reference.pose, found));
    return outcome;
  }
  std::array<Real, kMaxReadings> e_qe;
  for (int i : range(m)) e_qe[i] = reference.q_e[i] - q_e[i];
  if (corrects == Corrects::motors) {
    for (int i : range(m)) error[i] = e_qe[i];
    // Without what no motion of the platform corrects, against which the motors would only strain.
    if (overdriven(robot))
      error = reference.jacobians.joint_rate(pose_rate(reference.jacobians, error));
  } else {
    for (int k : range(m, m + robot.r)) e_qe[k] = reference.q_e[k] - q_e[k];
    for (int i : range(m)) {
      error[i] = 0;
      for (int c : range(m + robot.r)) error[i] += reference.tej[i][c] * e_qe[c];
    }
  }
  return {};
}

Outcome servo_cycle(const Robot& robot, Law law, const Coordinates& x_d, const Extended& q_e,
                    ServoCycle& cycle, Real band, const Weighing& weighing, Nearby* kept) {
  const int n = dof(robot.mobility), m = robot.motors;
  const Corrects corrects = properties(law).corrects;
  if (!all_finite(q_e, corrects == Corrects::motors ? m : readings(robot)) || !all_finite(x_d, n))
    return {Status::not_finite};
  Reference reference;
  if (kept) kept->left = cycle_steps(robot);
  const Outcome regular = refer(robot, law, x_d, reference, band, weighing, kept);
  if (!regular) return regular;
  Pose found;
  ServoCycle now;
  const Outcome outcome = motor_error(robot, law, reference, q_e, now.error, found, weighing,
                                      kept ? &kept->search : nullptr);
  if (!outcome) return outcome;
  if (!all_finite(now.error, m)) return {Status::not_finite};
  now.x = corrects == Corrects::pose ? to_coordinates(robot.mobility, found) : x_d;
  copy_first(m, reference.q_e, now.q_d);
  for (int i : range(n)) copy_first(m, reference.jacobians.J[i], now.J[i]);
  for (int i = 0; i < m && corrects == Corrects::readings; ++i)
    copy_first(m + robot.r, reference.tej[i], now.tej[i]);
  cycle = now;
  return regular;
}
}  // namespace truepose
