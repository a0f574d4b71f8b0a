// Rotational platforms of the tests: two ankles of public numbers, an assumed neck and lever.
#pragma once

#include "mechanisms.hpp"

namespace pivots_tested {

using namespace mechanisms;

/// A chain whose motor turns about +x, at 0 with its crank's end at B and the rod's at A.
Chain crank(const Vec3& base, const Vec3& B, const Vec3& A, const Vec3& carried_from);

void give_foot(Mechanism& mechanism);

/// Pitch about y, roll about the pitched x below it (feidedao/Parallel_Ankle_Joint).
Mechanism g1_ankle();

/// Both axes through the origin (AgibotTech/agibot_x1_infer).
Mechanism x1_ankle();

/// Three axes that do not meet, and lean: yaw, pitch, roll, moved by three cranks (assumed).
Mechanism neck();

/// One axis, one rod: a spatial four-bar.
Mechanism lever();

void for_each_pivot(const std::function<void(const Mechanism&)>& f);

void for_every(const std::function<void(const Mechanism&)>& f);

/// The part of its box that a robot reaches: corners of an ankle's are beyond its cranks.
inline double reach(Mobility K) { return is_rotational(K) ? 0.6 : 1; }

}  // namespace pivots_tested
