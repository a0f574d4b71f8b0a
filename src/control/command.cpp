// Motor positions for a commanded pose: the inverse model with every check.
#include "control/command.hpp"

namespace truepose {
Outcome command_full(const Robot& robot, const Coordinates& x, Joint& q) {
  const Outcome outcome = ikm_full(robot, x, q);
  if (!outcome) return outcome;
  return robot.full.own() ? same_full_mode(robot, x) : command(robot, x, q);
}
}  // namespace truepose
