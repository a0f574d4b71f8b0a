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

/// Redundant FKM as in the paper, of a robot for which `in_closed_form` holds: orientation from its
/// sensor (or fixed by the mobility), position from all spheres.
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Vec3& near_side, Pose& pose);

/// Steps from x_d or the last x̂ after which the search restarts at the motors' pose.
inline constexpr int kNearIterations = 5;

/// Cycles in a row in which a search may have no steps left. On robots as built and while their
/// geometry is learned one cycle suffices, from anywhere in the workspace a few.
inline constexpr int kSearchCycles = 8;

/// Where the next cycle's search for x̂ starts: at x_d; at the last x̂ where that took many steps; or
/// where one that had no steps left stopped. The latter two move along with x_d.
struct PoseSearch {
  int steps = -1;          ///< that an unfinished search has taken; -1: there is none
  int cycles = 0;          ///< that it has taken
  bool restarted = false;  ///< whether it has restarted at the motors' pose
  bool known = false;      ///< whether there is an x̂
  bool slow = false;       ///< whether it took more than kQuickSteps
  bool failed = false;     ///< the last search found no x̂: no answer until one does
  int left = 0;            ///< steps of closings that the last cycle has left
  Coordinates good{};      ///< last x̂ minus its x_d
  Coordinates at{};        ///< where the search stopped, minus x_d
};

/// Notes that a search has no steps left in this cycle. @param at  where it goes on
/// @param pose  out: the answer meanwhile, the last x̂, moved along with x_d; `at` where there is
/// none
/// @return not_converged after kSearchCycles, the next search starting at x_d, and from then on in
/// every cycle until a search has ended
Outcome note_unfinished(const Robot& robot, const Pose& desired, const Pose& at, int steps,
                        PoseSearch& on, Pose& pose);

/// Notes that a search has ended at x̂. @param slow  it took more than kQuickSteps
void note_found(const Robot& robot, const Pose& desired, const Pose& found, bool slow,
                PoseSearch& on);

/// x̂ of all readings, searched from x_d or the last one, then from the motors' pose.
/// @param C        the weights
/// @param desired  linearised there
/// @param rest     residual motion there, and the steps that closings may take
/// @param on       in, out
Outcome search_pose(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
                    const Expected& desired, const Extended& q_e, Parasitic rest, PoseSearch& on,
                    Pose& found);

/// Redundant FKM of any robot and sensors: in closed form if that uses every reading, else least
/// squares with the weights of the paper's TEJ: motors 1, sensors their own. To first order
/// J⁻¹ (x_d - x̂) is then TEJ (q_de - q_e), the TEJ law's.
/// @param near    start of the least squares; its D is on the platform's side of the spheres
/// @param nearby, on  as of `search_pose`
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Pose& near, Parasitic nearby,
                      PoseSearch& on, Pose& pose);

/// The same for coordinates x of any mobility, from the robot's home.
Outcome redundant_fkm(const Robot& robot, const Extended& q_e, Coordinates& x);
}  // namespace truepose
