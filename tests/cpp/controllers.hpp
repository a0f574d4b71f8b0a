// Controller settings of the tests.
#pragma once

#include "control/control.hpp"
#include "mechanisms.hpp"

namespace mechanisms {

/// Poles at 100 rad/s, damping 1, placed at home.
inline ControlSettings settings_for(const Robot& robot, Law law, Gains gains = Gains::diagonal) {
  ControlSettings settings;
  settings.law = law;
  settings.gains = gains;
  CHECK(place_poles(robot, robot.home, 100, 1, settings));
  return settings;
}

}  // namespace mechanisms
