// The redundant forward kinematic model: the pose of all readings, near a known one.
#pragma once

#include "estimation/estimate.hpp"

namespace truepose {
/// Whether the closed-form redundant FKM uses every reading: a robot that turns about z has no
/// sensor but θ's, or one that cannot turn has none.
inline bool in_closed_form(const Robot& robot) {
  if (robot.mobility == Mobility::schoenflies)
    return robot.r == 1 && properties(robot.sensor[0].kind).is_theta;
  return robot.mobility == Mobility::translation && robot.r == 0;
}

/// Redundant FKM in closed form, as in the paper: orientation from its sensor (or fixed by the
/// mobility), position from all spheres. @return not_measured where no sensor gives the orientation
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Vec3& near_side, Pose& pose);

/// Steps from x_d after which the search restarts at the motors' pose.
inline constexpr int kNearIterations = 5;

/// x̂ of all readings, searched from the desired pose with the weights there.
/// @param work, rest  as of `estimate`
Outcome find(const Robot& robot, const Knowledge& known, Real* work, const Pose& desired,
             const Extended& q_e, Pose& found, Parasitic rest);

/// Redundant FKM of any robot and sensors: in closed form if that uses every reading, else least
/// squares with the weights of the paper's TEJ: motors 1, sensors their own. To first order
/// J⁻¹ (x_d - x̂) is then TEJ (q_de - q_e), the TEJ law's.
/// @param near    start of the least squares; its D is on the platform's side of the spheres
/// @param nearby  residual motion there
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Pose& near,
                      const Parasitic& nearby, Pose& pose);

/// The same for coordinates x of any mobility, from the robot's home.
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, Coordinates& x);
}  // namespace truepose
