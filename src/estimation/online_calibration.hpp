// Online (recursive) calibration, one row of readings per cycle.
//
// A square-root filter on ξ. The unknown pose of each row is eliminated (eliminate.hpp): r
// equations about ξ alone remain, and each updates the root S of the covariance, Σ_ξ = S Sᵀ
// (Carlson's triangular form; Bierman, Factorization Methods for Discrete Sequential Estimation,
// 1977, chapter V). Bounded work, no allocation, no exception.
#pragma once

#include "estimation/changes.hpp"
#include "estimation/estimate.hpp"
#include "estimation/residual_test.hpp"
#include "mechanism/geometry.hpp"

namespace truepose {
/// State of the filter. The arrays are the caller's; it starts from the prior.
struct OnlineState {
  int count = 0;                         ///< p, uncertain parameters
  const std::int32_t* column = nullptr;  ///< each one's column of H_ξ
  Real* xi = nullptr;                    ///< ξ̂, parameter_count values
  Real* root = nullptr;                  ///< S, p×p by rows, lower triangular
  Extended sigma{};                      ///< σ of every reading's own error, > 0
  int due = 0;                           ///< index of the next drift
  Real* kept = nullptr;      ///< online_kept(count) numbers to roll back to; nullptr: none
  ResidualTest doubt{};      ///< disagreement of the readings, and whether it stopped the filter
  Window* window = nullptr;  ///< evidence of changes; nullptr: none
};

/// Settings of the filter. Constant during a run.
struct OnlineSettings {
  int drifts = 0;  ///< independent random walks, each of one or several parameters together
  const Real* drift = nullptr;  ///< drifts × p: change of every parameter by one σ in one cycle
  const Real* linearised = nullptr;  ///< ξ about which to linearise (replay); nullptr: ξ̂ itself
  /// σ beyond which a row's equations together are rejected: the row is excluded, or the one
  /// reading that explains them. Persistent disagreement stops the filter. 0: every row counts.
  Real gate = kGate;
  ChangeSettings changes{};
};

/// Curvature of the readings, per m or rad: a few times one over a robot's lengths, since its
/// Jacobians multiply it. Chosen by trial on H4s: with 1 and with 8 one pass ends farther from the
/// batch than with 12.
inline constexpr Real kCurvature = 12;

/// Numbers of work space for `observe`.
inline int online_work(const Robot& robot, int count) {
  const int m = readings(robot), r = redundancy(robot);
  return m * (parameter_count(robot) + count) + count + m * m + 2 * r * count;
}

/// Numbers of memory for OnlineState::kept: ξ̂ and S.
inline int online_kept(int count) { return count * (1 + count); }

namespace online_detail {
/// Information of one row of readings, the pose being unknown.
struct Line {
  Pose pose;                  ///< x̂
  RowsOfPose H_x;             ///< whitened
  Innovations innovations{};  ///< of the r equations about ξ; their F is in the work space
};

/// Layout of `observe`'s work space.
struct Work {
  Real *H_xi, *B, *F, *b, *G, *trial;
  Work(const Robot& robot, int count, Real* work)
      : H_xi(work),
        B(H_xi + readings(robot) * parameter_count(robot)),
        F(B + dof(robot.mobility) * count),
        b(F + redundancy(robot) * count),
        G(b + count),
        trial(G + readings(robot) * readings(robot)) {}
};

/// Makes the rows F of r equations independent, with their right sides e.
/// @param curvature  second-order remainder over the square of the loop residual
/// @return not_finite where an update by them would corrupt every later state
Outcome innovate(const OnlineSettings& settings, const OnlineState& state, int r, const Real* e,
                 Real curvature, const Work& work, Innovations& made);

/// m + r - n independent equations about ξ, by linearising about a pose of all readings.
/// @param without  excluded reading, or -1
Outcome understand(Level level, const Robot& robot, const OnlineSettings& settings,
                   const Extended& q_e, const OnlineState& state, const Pose& guess, int without,
                   const Work& work, Line& line);

/// Saves ξ̂ and S in online_kept(count) numbers.
void save(const OnlineState& state, Real* kept);
/// Restores them.
void restore(OnlineState& state, const Real* kept);

/// Whether no pose was found that fits the readings.
constexpr bool no_pose(Status status) {
  return status == Status::unreachable || status == Status::not_converged;
}

/// Adds a row to the evidence of disagreement. Without evidence, the state before this row is
/// saved; with too much, the saved one is restored.
void weigh_line(OnlineState& state, int readings, Real log_ratio);

/// Updates ξ̂ and S by a row's equations, and by a random walk.
void update(const OnlineSettings& settings, const Innovations& made, const Work& work,
            OnlineState& state);
}  // namespace online_detail

/// Runs one cycle: updates ξ̂ and S by one row of readings.
/// @param drawn   nominal robot, as for set_parameters
/// @param robot   in: any copy of it; out: the robot at the ξ of linearisation
/// @param pose    in: a guess; out: x̂ before ξ̂ moved
/// @param memory  online_work(drawn, count) numbers
/// @return `disagree`: no update, or none by the reading named; `stopped`: no update until `doubt`
/// is reset, and ξ̂ and S are back at their last good values. Both come with a pose. Without an
/// answer ξ̂ and S are unchanged, unless a row without a pose stops the filter.
Outcome observe(Level level, const Robot& drawn, const OnlineSettings& settings,
                const Extended& q_e, OnlineState& state, Robot& robot, Pose& pose, Real* memory);
}  // namespace truepose
