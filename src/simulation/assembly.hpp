// Assembly modes: all poses for the same motor positions, by searches from many random poses.
#pragma once

#include <random>
#include <vector>

#include "mechanism/fkm.hpp"

namespace truepose {
/// Modes nearer than this in position and orientation count as one, m and rad.
inline constexpr double kSameMode = 1e-6;

/// A pose found, and the number of searches that ended there.
struct AssemblyMode {
  Pose pose;
  int seen = 1;
};

/// Random poses that cover all solutions: orientations uniform, positions uniform over a box that
/// follows from q. Chain i holds D + R c_i on a sphere of radius L_i about B_i - a_i, so D is at
/// most L_i + |c_i| away from its centre.
/// @return home and `count` others; the same for the same seed on every platform
std::vector<Pose> random_starts(const Robot& robot, const Joint& q, int count, std::uint64_t seed);

/// Whether the end of a search closes the loops, in any working or assembly mode.
inline bool closes(const FkmResult& result) {
  return result || result.status == Status::branch_lost;
}

/// The distinct modes among the poses of searches, nearest to home first. A sorted projection makes
/// this as fast with few repeated poses as with many.
std::vector<AssemblyMode> distinct_modes(const Robot& robot, std::vector<Pose> found);
}  // namespace truepose
