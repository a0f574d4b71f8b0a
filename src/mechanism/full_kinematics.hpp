// IKM, FKM and Jacobian of the full level.
#pragma once

#include "mechanism/fkm.hpp"
#include "mechanism/full.hpp"

namespace truepose {
using FullResult = FkmResult;  ///< status, chain, iterations, residual: the largest gap of any rod

namespace full_detail {

/// Whether an arm and its rod are in line: the entry of J_q vanishes, and has no sign.
inline bool stretched(const FullClosure& at, int rod) {
  const Real size2 = at.v[rod].squaredNorm() * at.driven[rod / 2].dB.squaredNorm();
  return !(at.jq[rod] * at.jq[rod] > kSingular * size2);
}

/// Normal equations of A = -∂f/∂unknowns, factored to solve for a step.
struct Factors {
  Square A;
  NormalEquations square;

  template <class System>
  Factors(const System& system, const FullClosure& at, Real damping)
      : A(system.columns(at)), square(rods_of(system.robot), A, system.sizes(at), damping) {}
  Factors(const Factors&) = delete;  // `square` refers to A
  Factors& operator=(const Factors&) = delete;
  bool regular() const { return square.regular(); }
};

/// Newton on f, the closures of all rods, for a square system with A = -∂f/∂unknowns.
/// @param system  columns(at): A; sizes(at): see column_sizes; move(at, step, trial)
/// @param closed  take a start that closes the loops to rounding as it is, its rank not tested
template <class System>
inline FullResult newton(const Robot& robot, const System& system, FullClosure& at,
                         bool closed = false, int most = kFkmIterations) {
  const int N = rods_of(robot);
  FullResult result;
  Real scale = 0;
  for (int i = 0; i < dof(robot.mobility); ++i) {
    if (!(at.driven[i].rod > 0.5 * std::fabs(robot.chain[i].rod_difference)))
      return {{Status::unreachable, i}};  // a rod of no length
    scale = std::max(scale, at.driven[i].rod);
  }
  open_loops(robot, at);
  if (!std::isfinite(at.cost)) return {{Status::not_finite, -1}};

  NewtonEnd end;
  if (!(closed && at.residual <= kRounding * scale)) {
    FullClosure other;
    FullClosure *current = &at, *trial = &other;
    end = damped_newton(
        current, trial, scale, most,
        [&](const FullClosure& from, Real damping) { return Factors(system, from, damping); },
        [&](const FullClosure& from, const Factors& factors, FullClosure& after) {
          system.move(from, factors.square.solve(from.f), after);
          open_loops(robot, after);
        });
    if (current != &at) at = *current;
  }
  result.iterations = end.iterations;
  result.residual = at.residual;
  if (!(at.residual < kClosed * scale)) {
    // Close, but crawling: towards a singular pose (fkm.hpp).
    const bool crawls = at.residual < fkm_detail::kCrawls * scale && end.damping > 0;
    result.status = crawls ? Status::singular : Status::not_converged;
  } else if (!end.regular) {
    result.status = Status::singular;
  } else {
    for (int rod = 0; rod < N; ++rod) {
      const Chain& chain = robot.chain[rod / 2];
      const Real by_position = at.jq[rod] * at.driven[rod / 2].rate;  // only its sign counts
      if (chain.actuator != Actuator::telescopic && by_position * chain.working_mode < 0 &&
          !stretched(at, rod)) {
        result.status = Status::branch_lost;
        result.chain = rod / 2;
      }
    }
  }
  return result;
}

/// The rods' rows along the motion of full_row, in the columns of the unknowns: bars that turn
/// together share one, and a stress that nothing relieves has the last.
void free_row(const Robot& robot, const FullClosure& at, int rod,
              std::array<Real, kMaxUnknowns>& row);

/// Applies a step to the bars' turns; a stress in the place of the second is no motion.
void turn_bars(const Robot& robot, const Real* step, int count, FullPose& pose);

/// Σ|v|²|r|²: the diagonal of AᵀA if nothing cancelled, see column_sizes.
Real square_sum(const Robot& robot, const FullClosure& at, const std::array<Vec3, kMaxRods>& r);

/// Size² of the columns of `count` turns and of the bars or the stress, from `first` on.
void last_sizes(const Robot& robot, const FullClosure& at, int first, int turns, Unknowns& size);

/// Motors fixed, platform and bars move: unknowns D, R, ψ.
struct Forward {
  const Robot& robot;

  Square columns(const FullClosure& at) const {
    Square A;
    std::array<Real, kMaxUnknowns> row;
    for (int rod = 0; rod < rods_of(robot); ++rod) {
      free_row(robot, at, rod, row);
      std::copy_n(row.begin(), kMaxUnknowns, A[rod].begin());
    }
    return A;
  }
  Unknowns sizes(const FullClosure& at) const {
    Unknowns size;
    std::fill_n(size.begin(), 3,
                sum_of(rods_of(robot), [&](int rod) { return at.v[rod].squaredNorm(); }));
    last_sizes(robot, at, 3, 3, size);
    return size;
  }
  void move(const FullClosure& at, const Unknowns& step, FullClosure& trial) const {
    trial.q = at.q;
    trial.driven = at.driven;
    trial.pose.D = at.pose.D + Vec3(step[0], step[1], step[2]);
    trial.pose.R = exp_so3(Vec3(step[3], step[4], step[5])) * at.pose.R;
    trial.pose.theta = at.pose.theta;
    trial.pose.psi = at.pose.psi;
    turn_bars(robot, step.data() + 6, rods_of(robot) - 6, trial.pose);
  }
};

/// Turns of the platform that its coordinates leave out.
inline int tilts_of(const Robot& robot) { return turns_about_z(robot.mobility) ? 2 : 3; }

/// D and θ (of a translation robot: D) fixed; motors, platform tilt and bars move: unknowns q, the
/// turns that leave θ as it is, ψ.
struct Inverse {
  const Robot& robot;
  const int n = dof(robot.mobility), tilts = tilts_of(robot);

  /// Turn number j that leaves θ alone: along e_x, e_y (and e_z where θ is no coordinate).
  Vec3 turn(const Mat3& R, int j) const {
    Vec3 omega = Vec3::Unit(j);
    if (turns_about_z(robot.mobility)) omega.z() = -theta_row(R)[j];
    return omega;
  }
  Square columns(const FullClosure& at) const {
    Square A{};
    std::array<Real, kMaxUnknowns> row;
    for (int rod = 0; rod < rods_of(robot); ++rod) {
      free_row(robot, at, rod, row);
      A[rod][rod / 2] = -at.jq[rod];
      hidden(at.pose.R, row, A[rod]);
    }
    return A;
  }
  /// Entries from n on, of a quantity that changes as `row` along the motion of full_row.
  void hidden(const Mat3& R, const std::array<Real, kMaxUnknowns>& row, Unknowns& entry) const {
    for (int j = 0; j < tilts; ++j) entry[n + j] = Vec3(row[3], row[4], row[5]).dot(turn(R, j));
    for (int k = n + tilts; k < rods_of(robot); ++k) entry[k] = row[6 + k - n - tilts];
  }
  Unknowns sizes(const FullClosure& at) const {
    Unknowns size;
    for (int i = 0; i < n; ++i) {
      const Driven& driven = at.driven[i];
      const bool leg = robot.chain[i].actuator == Actuator::telescopic;
      size[i] = (at.v[2 * i].squaredNorm() + at.v[2 * i + 1].squaredNorm()) *
                (leg ? driven.rate * driven.rate : driven.dB.squaredNorm());
    }
    last_sizes(robot, at, n, tilts, size);
    return size;
  }
  void move(const FullClosure& at, const Unknowns& step, FullClosure& trial) const {
    for (int i = 0; i < n; ++i) {
      trial.q[i] = at.q[i] + step[i];
      trial.driven[i] = driven_point(robot.chain[i], trial.q[i]);
    }
    Vec3 omega = Vec3::Zero();
    for (int j = 0; j < tilts; ++j) omega += step[n + j] * turn(at.pose.R, j);
    trial.pose = at.pose;
    trial.pose.R = exp_so3(omega) * at.pose.R;
    if (turns_about_z(robot.mobility)) trial.pose.R = with_theta(trial.pose.R, at.pose.theta);
    turn_bars(robot, step.data() + n + tilts, rods_of(robot) - n - tilts, trial.pose);
  }
};

/// Whether the determinant of all rods' rows has another sign than at home.
inline bool other_full_mode(const Robot& robot, const FullClosure& at) {
  return other_mode(robot.full.sign, determinant_sign(rods_of(robot), Forward{robot}.columns(at)));
}

/// Calls own() where the full level is its own, same() where it is the ideal one.
template <class Own, class Same>
inline auto with_full(const Robot& robot, Own&& own, Same&& same) {
  using Result = decltype(same());
  Result none{};
  none.chain = -1;
  none.status = Status::unfinished;
  if (!robot.finished) return none;
  if (robot.full.kind == FullKind::same) return same();
  if (robot.full.own()) return own();
  none.status = Status::no_full_level;
  return none;
}
}  // namespace full_detail

/// Pose of the mechanism with the motors at q, all rods closed. The full level must be its own.
/// @param pose  in: the guess; out: D, R, ψ (the last iterate if not ok)
inline FullResult fkm_full(const Robot& robot, const Joint& q, FullPose& pose, FullClosure& closure,
                           int cap = kFkmCap) {
  if (!robot.finished) return {{Status::unfinished, -1}};
  closure.pose = pose;
  closure.q = q;
  for (int i = 0; i < dof(robot.mobility); ++i) {
    if (!std::isfinite(q[i])) return {{Status::not_finite, i}};
    closure.driven[i] = driven_point(robot.chain[i], q[i]);
  }
  FullResult result = full_detail::newton(robot, full_detail::Forward{robot}, closure, false,
                                          std::min(kFkmIterations, cap));
  pose = closure.pose;
  pose.theta = theta_of(pose.R, pose.theta);
  closure.pose.theta = pose.theta;
  if (result && full_detail::other_full_mode(robot, closure)) result.status = Status::branch_lost;
  return result;
}

/// Residual motion of a closure against the ideal level at its D and θ, with ideal motors at q.
Parasitic beyond_ideal(const Robot& robot, const FullClosure& closure, const Pose& ideal,
                       const Joint& q);

/// Motor positions, tilt and bars' turns that hold D and θ (of a translation robot: D), all rods
/// closed. Starts at the ideal inverse model.
/// @param rest  in: residual motion at a pose nearby; out: at this one, if ok
inline FullResult ikm_full(const Robot& robot, const Pose& pose, FullClosure& closure,
                           Parasitic* rest = nullptr) {
  Closure ideal;
  const Outcome outcome = ikm(robot, pose, ideal);
  if (!outcome) return {outcome};
  const Joint q = ideal.q();
  FullResult result;
  for (bool near = rest && rest->known;; near = false) {
    closure.pose = near ? rest->beside(pose) : to_full(pose);
    for (int i = 0; i < dof(robot.mobility); ++i) {
      closure.q[i] = near ? q[i] + rest->q[i] : q[i];
      closure.driven[i] = driven_point(robot.chain[i], closure.q[i]);
    }
    result = full_detail::newton(robot, full_detail::Inverse{robot}, closure, near);
    if (result || !near) break;
  }
  closure.pose.theta = theta_of(closure.pose.R, pose.theta);
  if (result && rest) *rest = beyond_ideal(robot, closure, pose, q);
  return result;
}

namespace full_detail {
/// Calls f(closure) with all rods closed at x, same() where the full level is the ideal one.
/// @return f's or same's outcome, or why the rods do not close
template <class F, class Same>
inline Outcome closed(const Robot& robot, const Coordinates& x, F&& f, Same&& same) {
  return with_full(
      robot,
      [&]() -> Outcome {
        FullClosure closure;
        const Outcome outcome = ikm_full(robot, to_pose(robot.mobility, x), closure);
        return outcome ? f(closure) : outcome;
      },
      same);
}
}  // namespace full_detail

/// Derivatives at the full level by the implicit function theorem: A ż = Q q̇ with z = (D, R, ψ).
struct FullJacobians {
  Matrix<kMaxUnknowns, kMaxDof> Z;  ///< ∂z/∂q, z as the motion of full_row
  Square J;                         ///< ∂x/∂q, its rows of D and θ
};

/// @return singular when the rods' rows lose rank, or (with the chain) an arm is stretched
Outcome jacobian_full(const Robot& robot, const FullClosure& closure, FullJacobians& jacobians);

/// x = FKM(q) at the full level. @param x  in: the guess; out: the pose @param cap  iterations
inline FullResult fkm_full(const Robot& robot, const Joint& q, Coordinates& x, int cap = kFkmCap) {
  return full_detail::with_full(
      robot,
      [&]() {
        FullPose pose = to_full(to_pose(robot.mobility, x));
        FullClosure closure;
        const FullResult result = fkm_full(robot, q, pose, closure, cap);
        x = to_coordinates(robot.mobility, pose);
        return result;
      },
      [&] { return fkm(robot, q, x, cap); });
}

/// q = IKM(x) at the full level.
/// @return joint_limit where a motor would have to pass its stops (`q` then shows how far)
Outcome ikm_full(const Robot& robot, const Coordinates& x, Joint& q);

/// Residual motion at the full level: the platform's turns against the ideal R (about x and y, of a
/// translation robot about z as well) and each bar's turn against the base, θ + ψ_k.
Outcome parasitic(const Robot& robot, const Coordinates& x, Coordinates& rest);

/// J(x) at the full level, ẋ = J q̇.
Outcome jacobian_full(const Robot& robot, const Coordinates& x, JointMatrix& J);
}  // namespace truepose
