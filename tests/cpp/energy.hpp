// Energy of a robot, by its model's masses: a check on its motion.
#pragma once

#include "control/dynamics.hpp"
#include "mechanisms.hpp"

namespace mechanisms {

/// Kinetic and potential energy, J; their sum is constant in free motion without friction.
struct Energy {
  Real kinetic = 0, potential = 0;
};
Outcome energy(const Robot& robot, const Pose& pose, const Coordinates& rate, Energy& result);

}  // namespace mechanisms
