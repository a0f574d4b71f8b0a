// The forward kinematic model (FKM), by damped Newton iteration.
#include "mechanism/fkm.hpp"

namespace truepose {
namespace {
/// Gauss-Newton steps from nearly closed loops to the least squares of the motors' readings: the
/// gap f of a loop is that of its reading times J_q. @param end  in, out: steps so far, rank
/// @return whether they converged
bool settle(const Robot& robot, const std::array<Driven, kMaxMotors>& driven, int most, Loops& at,
            NewtonEnd& end) {
  const int n = at.carried.n, m = robot.motors;
  Real moves = INFINITY;
  while (end.iterations < most && end.regular && moves > kNothingToGain) {
    ++end.iterations;
    Joint gap;
    for (int i : range(m)) {
      at.chain[i].jq = jq_entry(robot.chain[i], at.chain[i].v, driven[i]);
      gap[i] = at.f[i] / at.chain[i].jq;
    }
    Square K;
    const Unknowns size = inverse_rows(at, K);
    const Factors equations(m, n, K.data(), size);
    end.regular = equations.regular();
    if (!end.regular) return false;
    const Unknowns step = equations.solve(gap.data());
    Coordinates motion{};
    copy_first(n, step, motion);
    moves = 0;
    for (int j : range(n)) moves = max(moves, fabs(motion[j]));
    at.place(robot, driven, moved(robot.mobility, at.pose, motion));
  }
  return moves < kChord;
}
}  // namespace

FkmResult search(const Robot& robot, const Joint& q, Pose& pose, int most) {
  if (!robot.finished) return {{Status::unfinished}};
  if (is_mechanism(robot.mobility)) return {{Status::no_chains}};
  const int n = dof(robot.mobility), m = robot.motors;
  FkmResult result;
  std::array<Driven, kMaxMotors> driven;
  Real scale = 0;  // the longest rod
  for (int i : range(m)) {
    driven[i] = driven_point(robot.chain[i], q[i]);
    if (!isfinite(q[i])) return {{Status::not_finite, i}};
    if (!(driven[i].rod > 0)) return {{Status::unreachable, i}};  // a telescopic leg
    scale = max(scale, driven[i].rod);
  }
  Loops iterates[2], *current = &iterates[0], *trial = &iterates[1];
  current->place(robot, driven, pose);
  if (!isfinite(current->cost)) return {{Status::not_finite}};
  Square jx;
  NewtonEnd end = damped_newton(
      current, trial, scale, most,
      [&](const Loops& at, Real damping) {
        const Unknowns size = jx_rows(at, jx);
        return Factors(m, n, jx.data(), size, damping);
      },
      [&](const Loops& at, const Factors& factors, Loops& after) {
        const Unknowns step = factors.solve(at.f.data());
        Coordinates motion;
        copy_first(n, step, motion);
        after.place(robot, driven, moved(robot.mobility, at.pose, motion));
      },
      m > n ? kSettled : 0);
  const Real closed = scale * (m > n ? kDisagreement : kClosed);
  const bool open = current->residual > kClosed * scale && current->residual < closed;
  const bool settled = !open || settle(robot, driven, most, *current, end);
  result.iterations = end.iterations;

  if (turns_about_z(robot.mobility)) {
    Real& theta = current->pose.theta;
    if (fabs(theta) > 1000) theta = theta_of(current->pose.R, theta);
  }
  result.residual = current->residual;
  if (!(settled && current->residual < closed)) {
    const bool crawls = end.crawls(current->residual, scale);
    result.status = crawls ? Status::singular : Status::not_converged;
  } else if (!end.regular) {
    result.status = Status::singular;
  } else {
    for (int i : range(m)) {
      const Chain& chain = robot.chain[i];
      if (chain.actuator != Actuator::telescopic &&
          jq_entry(chain, current->chain[i].v, driven[i]) * driven[i].rate * chain.working_mode <
              0) {
        result.status = Status::branch_lost;
        result.chain = i;
      }
    }
    jx_rows(*current, jx);
    if (m == n && other_mode(robot.assembly_sign, determinant_sign(n, jx)))
      result.status = Status::branch_lost;
  }
  pose = current->pose;
  return result;
}

namespace {
/// Whether it is certain that no pose closes the loops. Each chain holds D + R c_i on a sphere
/// about S_i = B_i - a_i. Of the lengths |S_iS_j|, L_i, L_j and |c_i - c_j|, which no turn changes,
/// none can exceed the sum of the others. Where R is known, the spheres themselves decide.
bool no_pose(const Robot& robot, const Joint& q) {
  const bool turns = turns_about_z(robot.mobility) || robot.mobility >= Mobility::spatial;
  if (robot.mobility == Mobility::translation) {
    Vec3 D;
    const Vec3 side = to_pose(robot.mobility, robot.home).D;
    return fkm_closed(robot, q, Mat3::Identity(), side, D).status == Status::unreachable;
  }
  for (int i : range(robot.motors))
    for (int j : range(i)) {
      const Chain &one = robot.chain[i], &other = robot.chain[j];
      const Driven from = driven_point(one, q[i]), to = driven_point(other, q[j]);
      const Vec3 pivots = one.pivot - other.pivot;
      Vec3 centres = one.base + from.p - one.anchor - other.base - to.p + other.anchor;
      if (!turns) centres -= pivots;
      const std::array<Real, 4> side{centres.norm(), from.rod, to.rod, turns ? pivots.norm() : 0};
      const Real whole = side[0] + side[1] + side[2] + side[3];
      for (const Real one_side : side)
        if (2 * one_side > whole * (1 + kClosed)) return true;
    }
  return false;
}

/// Whether a pose is in the robot's own assembly mode.
bool own_mode(const Robot& robot, const Pose& pose) {
  Closure closure;
  Jacobians jacobians;
  return ikm(robot, pose, closure, false) && jacobian(closure, jacobians) &&
         !other_mode(robot.assembly_sign, jacobians.sign);
}

/// Searches again from home, with the motors moved to q in stages. Applies where the first search
/// found no pose or jumped from the robot's own assembly mode into another.
/// @param pose  in: the end of the first search from `guess`; out: the pose, or unchanged
FkmResult search_from_home(const Robot& robot, const Joint& q, FkmResult first, const Pose& guess,
                           Pose& pose, int cap) {
  const bool went = first.status == Status::not_converged || first.status == Status::singular ||
                    first.status == Status::branch_lost;
  if (!went) return first;  // no start has a pose for such an input
  if (first.status == Status::branch_lost && !own_mode(robot, guess)) return first;
  if (first.status == Status::not_converged && no_pose(robot, q)) {
    first.status = Status::unreachable;
    return first;
  }
  const int most = min(kFkmIterations, cap - first.iterations);
  Closure home;
  FkmResult second{{Status::not_converged}};
  if (most >= 2 * kFkmStages)  // a stage needs at least two steps
    second.status = ikm(robot, to_pose(robot.mobility, robot.home), home).status;
  Pose at = home.pose;
  if (second)
    second = in_stages(most, [&](Real rest, int left) {
      Joint motors{};
      for (int i : range(robot.motors))
        motors[i] = q[i] - rest * within_turn(robot.chain[i], q[i] - home.chain[i].q);
      return search(robot, motors, at, left);
    });
  second.iterations += first.iterations;
  first.iterations = second.iterations;
  if (!second) return first;
  pose = at;
  if (turns_about_z(robot.mobility)) pose.theta = theta_of(pose.R, guess.theta);
  return second;
}
}  // namespace

FkmResult fkm(const Robot& robot, const Joint& q, Pose& pose, int cap) {
  const Pose guess = pose;
  const FkmResult first = search(robot, q, pose, min(kFkmIterations, cap));
  if (first) return first;
  return search_from_home(robot, q, first, guess, pose, cap);
}
}  // namespace truepose
