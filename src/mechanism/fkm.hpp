// The forward kinematic model (FKM), by damped Newton iteration.
#pragma once

#include "math/newton.hpp"
#include "mechanism/damping.hpp"
#include "mechanism/fkm_closed.hpp"
#include "mechanism/loops.hpp"

namespace truepose {
inline constexpr int kFkmIterations = 60;  ///< in one search; fkm makes at most two
inline constexpr int kFkmStages = 4;       ///< in the second search, from home
/// Default cap for both searches together. Over a workspace, 4 iterations suffice from a nearby
/// guess and 7 from home (tests/cpp/test_forward_kinematics.cpp).
inline constexpr int kFkmCap = 2 * kFkmIterations;

/// Cap where the pose only starts another search. Only poses near singularities need more, and from
/// there the other search converges by itself.
inline constexpr int kFkmStart = 24;

/// Motors beyond the freedoms leave the loops open by what their readings disagree. As share of the
/// longest rod, gaps up to this belong to a pose: errors of geometry and of references, not a
/// reading of another posture.
inline constexpr Real kDisagreement = 0.02;
/// Share of Σf² by which such a search still changes it when it turns to the readings' least
/// squares.
inline constexpr Real kSettled = 1e-3;

/// Result of a search for the pose.
struct [[nodiscard]] FkmResult : Outcome {
  int iterations = 0;  ///< steps tried, at most the cap
  Real residual = 0;   ///< largest closure error | |v_i| - L_i |, m
};

/// Searches once, by Newton's method; with more motors than freedoms, for the pose at which the
/// motors' readings deviate least in least squares (to first order: Σ(f_i/J_q,i)²). @param pose in:
/// the guess; out: the pose or last iterate
FkmResult search(const Robot& robot, const Joint& q, Pose& pose, int most = kFkmIterations);

namespace fkm_detail {
/// Residual, in units of the longest rod, below which a slowly converging search is near a double
/// root: its steps halve the distance, and the residual goes with their square.
inline constexpr Real kCrawls = by_precision(1e-9, 1e-6);
/// Conditioning there, of the order of the square root of kCrawls.
inline constexpr Real kDependent = 1e-4;

/// Whether it is certain that no pose closes the loops. Each chain holds D + R c_i on a sphere
/// about S_i = B_i - a_i. Of the lengths |S_iS_j|, L_i, L_j and |c_i - c_j|, which no turn changes,
/// none can exceed the sum of the others. Where R is known, the spheres themselves decide.
bool no_pose(const Robot& robot, const Joint& q, const std::array<Driven, kMaxMotors>& driven);

/// Whether a search converged slowly to a singular pose: the loops are closed up to its small
/// steps, and the rods' lines are dependent. (J_x is singular, J_xᵀf = 0, also where a search ends
/// with open loops, but that does not exclude other poses.)
bool crawled(const Robot& robot, const std::array<Driven, kMaxMotors>& driven, const Pose& pose,
             Real residual);

/// Whether a pose is in the robot's own assembly mode.
bool own_mode(const Robot& robot, const Pose& pose);

/// Searches again from home, with the motors moved to q in stages. Applies where the first search
/// found no pose or jumped from the robot's own assembly mode into another.
/// @param pose  in: the end of the first search from `guess`; out: the pose, or unchanged
FkmResult search_from_home(const Robot& robot, const Joint& q, FkmResult first, const Pose& guess,
                           Pose& pose, int cap);
}  // namespace fkm_detail

/// Computes the pose from the motors' positions q, by a search from the guess, then one from home
/// if the first finds no pose in the robot's own modes.
/// @param pose  in: the guess; out: the pose (the last iterate of the first search if not ok)
/// @param cap   maximum steps of both searches, at least 1
/// @return unreachable: certainly no pose closes the loops. not_converged: none was found, or with
/// more motors than freedoms none within kDisagreement. singular: closed, but the motors do not
/// determine the pose. branch_lost: closed in another mode (assembly modes of a robot with more
/// motors than freedoms are not told apart).
FkmResult fkm(const Robot& robot, const Joint& q, Pose& pose, int cap = kFkmCap);
}  // namespace truepose
