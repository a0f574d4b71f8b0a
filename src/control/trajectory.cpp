// A straight move with a quintic time law.
#include "control/trajectory.hpp"

namespace truepose {
Setpoint quintic(Mobility mobility, const Coordinates& from, const Coordinates& to, Real duration,
                 Real time) {
  const Real u = std::clamp(time / duration, 0.0, 1.0);
  const Real s = u * u * u * (10 + u * (6 * u - 15));
  const Real s1 = 30 * u * u * (1 + u * (u - 2)) / duration;
  const Real s2 = 60 * u * (1 + u * (2 * u - 3)) / (duration * duration);
  const Pose start = to_pose(mobility, from);
  const Coordinates whole = difference(mobility, to_pose(mobility, to), start);
  Setpoint setpoint;
  Coordinates part{};
  for (int i = 0; i < dof(mobility); ++i) {
    part[i] = s * whole[i];
    setpoint.rate[i] = s1 * whole[i];
    setpoint.acceleration[i] = s2 * whole[i];
  }
  setpoint.x = to_coordinates(mobility, moved(mobility, start, part));
  return setpoint;
}
}  // namespace truepose
