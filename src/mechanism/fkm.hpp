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

/// Cap where the pose only starts another search: from near a singularity that one converges by
/// itself.
inline constexpr int kFkmStart = kUsualSteps;

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

/// Searches with what is held moved to its end in stages.
/// @param search  search(rest, most): with this share of the way to go, in at most so many steps
template <class Search>
FkmResult in_stages(int most, Search&& search) {
  FkmResult result;
  for (int stage = kFkmStages - 1; stage >= 0 && result; --stage) {
    const int tried = result.iterations;
    if (tried >= most) return {{Status::not_converged}, tried};
    result = search(Real(stage) / kFkmStages, most - tried);
    result.iterations += tried;
  }
  return result;
}

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
