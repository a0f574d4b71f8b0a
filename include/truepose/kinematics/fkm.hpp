// The forward kinematic model (FKM), by damped Newton iteration.
#pragma once

#include "truepose/kinematics/damping.hpp"
#include "truepose/kinematics/fkm_closed.hpp"
#include "truepose/kinematics/loops.hpp"
#include "truepose/math/newton.hpp"

namespace truepose {
inline constexpr int kFkmIterations = 60;  ///< in one search; fkm makes at most two
inline constexpr int kFkmStages = 4;       ///< in the second search, from home
/// Default cap for both searches together. Over a workspace, 4 iterations suffice from a nearby
/// guess and 7 from home (tests/cpp/test_forward_kinematics.cpp).
inline constexpr int kFkmCap = 2 * kFkmIterations;

/// Cap where the pose only starts another search. Only poses near singularities need more, and from
/// there the other search converges by itself.
inline constexpr int kFkmStart = 24;

/// Result of a search for the pose.
struct [[nodiscard]] FkmResult : Outcome {
  int iterations = 0;  ///< steps tried, at most the cap
  Real residual = 0;   ///< largest closure error | |v_i| - L_i |, m
};

/// Searches once, by Newton's method. @param pose  in: the guess; out: the pose or last iterate
inline FkmResult search(const Robot& robot, const Joint& q, Pose& pose,
                        int most = kFkmIterations) {
  if (!robot.finished) return {{Status::unfinished, -1}};
  const int n = dof(robot.mobility);
  FkmResult result;
  std::array<Driven, kMaxChains> driven;
  Real scale = 0;  // the longest rod
  for (int i = 0; i < n; ++i) {
    driven[i] = driven_point(robot.chain[i], q[i]);
    if (!std::isfinite(q[i])) return {{Status::not_finite, i}};
    if (!(driven[i].rod > 0)) return {{Status::unreachable, i}};  // a telescopic leg
    scale = std::max(scale, driven[i].rod);
  }
  Loops iterates[2], *current = &iterates[0], *trial = &iterates[1];
  current->place(robot, driven, pose);
  if (!std::isfinite(current->cost)) return {{Status::not_finite, -1}};

  struct Inverse : Inverted {
    Square rows;
    bool regular() const { return Inverted::regular; }
  };
  Square jx;
  const NewtonEnd end = damped_newton(
      current, trial, scale, most,
      [&](const Loops& at, Real damping) {
        Inverse inverse;
        at.jx(jx);
        static_cast<Inverted&>(inverse) = invert(n, jx, at.sizes(), damping, inverse.rows);
        return inverse;
      },
      [&](const Loops& at, const Inverse& inverse, Loops& after) {
        Coordinates motion{};
        for (int j = 0; j < n; ++j)
          motion[j] = sum_of(n, [&](int i) { return inverse.rows[j][i] * at.f[i]; });
        after.place(robot, driven, moved(robot.mobility, at.pose, motion));
      });
  result.iterations = end.iterations;

  if (turns_about_z(robot.mobility)) {
    Real& theta = current->pose.theta;
    if (std::fabs(theta) > 1000) theta = theta_of(current->pose.R, theta);
  }
  result.residual = current->residual;
  if (!(current->residual < kClosed * scale)) {
    result.status = Status::not_converged;
  } else if (!end.regular) {
    result.status = Status::singular;
  } else {
    for (int i = 0; i < n; ++i) {
      const Chain& chain = robot.chain[i];
      if (chain.actuator != Actuator::telescopic &&
          jq_entry(chain, current->v[i], driven[i]) * driven[i].rate * chain.working_mode < 0) {
        result.status = Status::branch_lost;
        result.chain = i;
      }
    }
    current->jx(jx);
    if (other_mode(robot.assembly_sign, determinant_sign(n, jx)))
      result.status = Status::branch_lost;
  }
  pose = current->pose;
  return result;
}

namespace fkm_detail {
/// Residual, in units of the longest rod, below which a slowly converging search is near a double
/// root: its steps halve the distance, and the residual goes with their square.
inline constexpr Real kCrawls = by_precision(1e-9, 1e-6);
/// Conditioning there, of the order of the square root of kCrawls.
inline constexpr Real kDependent = 1e-4;

/// Whether it is certain that no pose closes the loops. Each chain holds D + R c_i on a sphere
/// about S_i = B_i - a_i. Of the lengths |S_iS_j|, L_i, L_j and |c_i - c_j|, which no turn changes,
/// none can exceed the sum of the others. Where R is known, the spheres themselves decide.
inline bool no_pose(const Robot& robot, const Joint& q, const std::array<Driven, kMaxDof>& driven) {
  const int n = dof(robot.mobility);
  const bool turns = turns_about_z(robot.mobility) || robot.mobility >= Mobility::spatial;
  if (robot.mobility == Mobility::translation) {
    Vec3 D;
    const Vec3 side = to_pose(robot.mobility, robot.home).D;
    return fkm_closed(robot, q, Mat3::Identity(), side, D).status == Status::unreachable;
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j) {
      const Chain &one = robot.chain[i], &other = robot.chain[j];
      const Driven &from = driven[i], &to = driven[j];
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

/// Whether a search converged slowly to a singular pose: the loops are closed up to its small
/// steps, and the rods' lines are dependent. (J_x is singular, J_xᵀf = 0, also where a search ends
/// with open loops, but that does not exclude other poses.)
inline bool crawled(const Robot& robot, const std::array<Driven, kMaxDof>& driven, const Pose& pose,
                    Real residual) {
  Real scale = 0;
  for (int i = 0; i < robot.chains; ++i) scale = std::max(scale, driven[i].rod);
  if (!(residual < kCrawls * scale)) return false;
  Closure closure;
  closure.pose = pose;
  closure.carried = carried_frames(robot, pose);
  const Pose& placed = closure.placed();
  for (int i = 0; i < dof(robot.mobility); ++i) {
    const Chain& chain = robot.chain[i];
    ChainState& state = closure.chain[i];
    state.lever = placed.R * chain.pivot;
    state.v = chain.base + driven[i].p - placed.D - state.lever - chain.anchor;
    state.dB = driven[i].dB;
    state.rate = driven[i].rate;
  }
  return Conditioning(closure).parallel() < kDependent;
}

/// Whether a pose is in the robot's own assembly mode.
inline bool own_mode(const Robot& robot, const Pose& pose) {
  Closure closure;
  Jacobians jacobians;
  return ikm(robot, pose, closure, false) && jacobian(closure, jacobians) &&
         !other_mode(robot.assembly_sign, jacobians.sign);
}

/// Searches again from home, with the motors moved to q in stages. Applies where the first search
/// found no pose or jumped from the robot's own assembly mode into another.
/// @param pose  in: the end of the first search from `guess`; out: the pose, or unchanged
inline FkmResult search_from_home(const Robot& robot, const Joint& q, FkmResult first,
                                         const Pose& guess, Pose& pose, int cap) {
  const bool went = first.status == Status::not_converged || first.status == Status::singular ||
                    first.status == Status::branch_lost;
  if (!went) return first;  // no start has a pose for such an input
  if (first.status == Status::branch_lost && !own_mode(robot, guess)) return first;
  const bool open = first.status == Status::not_converged;
  std::array<Driven, kMaxDof> driven;
  for (int i = 0; i < dof(robot.mobility) && open; ++i) driven[i] = driven_point(robot.chain[i], q[i]);
  if (open && no_pose(robot, q, driven)) {
    first.status = Status::unreachable;
    return first;
  }
  Closure home;
  int most = std::min(kFkmIterations, cap - first.iterations);
  if (most < 2 * kFkmStages) most = 0;  // a stage needs at least two steps
  FkmResult second{{Status::not_converged}};
  if (most > 0) second.status = ikm(robot, to_pose(robot.mobility, robot.home), home).status;
  Pose at = home.pose;
  int stage = 0, left = most;
  while (second && stage < kFkmStages && left > 0) {
    ++stage;
    Joint motors{};
    for (int i = 0; i < dof(robot.mobility); ++i) {
      const Real way = within_turn(robot.chain[i], q[i] - home.chain[i].q);
      motors[i] = q[i] - way * (kFkmStages - stage) / kFkmStages;
    }
    second = search(robot, motors, at, left);
    left -= second.iterations;
  }
  first.iterations += most - left;
  if (second && stage == kFkmStages) {
    pose = at;
    if (turns_about_z(robot.mobility)) pose.theta = theta_of(pose.R, guess.theta);
    second.iterations = first.iterations;
    return second;
  }
  if (open && crawled(robot, driven, pose, first.residual)) first.status = Status::singular;
  return first;
}
}  // namespace fkm_detail

/// Computes the pose from the motors' positions q, by a search from the guess, then one from home
/// if the first finds no pose in the robot's own modes.
/// @param pose  in: the guess; out: the pose (the last iterate of the first search if not ok)
/// @param cap   maximum steps of both searches, at least 1
/// @return unreachable: certainly no pose closes the loops. not_converged: none was found.
/// singular: closed, but the motors do not determine the pose. branch_lost: closed in another mode.
inline FkmResult fkm(const Robot& robot, const Joint& q, Pose& pose, int cap = kFkmCap) {
  const Pose guess = pose;
  const FkmResult first = search(robot, q, pose, std::min(kFkmIterations, cap));
  if (first) return first;
  return fkm_detail::search_from_home(robot, q, first, guess, pose, cap);
}

/// x = FKM(q). @param x  in: the guess; out: the pose. @param cap  maximum steps, at least 1
inline FkmResult fkm(const Robot& robot, const Joint& q, Coordinates& x, int cap = kFkmCap) {
  Pose pose = to_pose(robot.mobility, x);
  const FkmResult result = fkm(robot, q, pose, cap);
  x = to_coordinates(robot.mobility, pose);
  return result;
}
}  // namespace truepose
