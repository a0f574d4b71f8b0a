#include "full_robots.hpp"

namespace mechanisms {
void for_each_full(const std::function<void(const Mechanism&)>& f) { for_all(with_pairs(), f); }

double gaussian(check::Random& random) {
  const double u = 0.5 * (1 - random()), angle = std::numbers::pi * random();
  return std::sqrt(-2 * std::log(std::max(u, 1e-300))) * std::cos(angle);
}

void turn_axis(Chain& chain, double yaw, double tilt) {
  const Mat3 about_z = rotation_z(yaw);
  chain.zero = about_z * chain.zero;
  const Mat3 turn = exp_so3(tilt * chain.zero) * about_z;
  chain.axis = turn * chain.axis;
  chain.pair_axis = turn * chain.pair_axis;
}

Robot with_axis_errors(Robot robot, check::Random& random) {
  for (int i = 0; i < dof(robot.mobility); ++i) {
    const double yaw = degrees(0.1) * gaussian(random), tilt = degrees(0.1) * gaussian(random);
    turn_axis(robot.chain[i], yaw, tilt);
  }
  return robot;
}
}  // namespace mechanisms
