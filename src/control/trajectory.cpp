// Setpoints along a quintic time law.
#include "control/trajectory.hpp"

namespace truepose {
Setpoint between(Mobility mobility, const Setpoint& from, const Setpoint& to, Real duration,
                 Real u) {
  if (u == 0 || u == 1) return u == 0 ? from : to;
  const Real T = duration;
  const Pose start = to_pose(mobility, from.x);
  const Coordinates whole = difference(mobility, to_pose(mobility, to.x), start);
  Setpoint found;
  Coordinates step{};
  for (int i : range(dof(mobility))) {
    const Real v = T * from.rate[i], c = T * T * from.acceleration[i];
    const Real off = whole[i] - v - c / 2, faster = T * to.rate[i] - v - c;
    const Real harder = T * T * to.acceleration[i] - c;
    const Real c3 = 10 * off - 4 * faster + harder / 2, c4 = 7 * faster - 15 * off - harder;
    const Real c5 = 6 * off - 3 * faster + harder / 2;
    step[i] = u * (v + u * (c / 2 + u * (c3 + u * (c4 + u * c5))));
    found.rate[i] = (v + u * (c + u * (3 * c3 + u * (4 * c4 + u * 5 * c5)))) / T;
    found.acceleration[i] = (c + u * (6 * c3 + u * (12 * c4 + u * 20 * c5))) / (T * T);
  }
  found.x = to_coordinates(mobility, moved(mobility, start, step));
  return found;
}
}  // namespace truepose
