// Values and derivatives of all readings at the full level.
#pragma once

#include "estimation/linearise.hpp"
#include "mechanism/full.hpp"

namespace truepose {
/// q_e, H_x and H_ξ of the full level, as linearise() for the ideal one: D and θ (of a translation
/// robot: D) are held, the platform's tilt and its bars' turns follow.
/// @param rest  as of ikm_full
/// @return also no_full_level (robot.full)
Outcome linearise_full(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                       Real* H_xi, Parasitic* rest = nullptr);

/// The level whose rods a robot's laws model.
inline Level level_of(const Robot& robot) {
  return robot.rod_by_rod() ? Level::full : Level::ideal;
}

/// q_e, H_x and H_ξ of a level. @param rest  as of ikm_full
inline Outcome linearise(Level level, const Robot& robot, const Pose& pose, Extended& q_e,
                         PoseRows& H_x, Real* H_xi, Parasitic& rest) {
  return level == Level::full ? linearise_full(robot, pose, q_e, H_x, H_xi, &rest)
                              : linearise(robot, pose, q_e, H_x, H_xi);
}
}  // namespace truepose
