#include "controllers.hpp"

namespace mechanisms {
ControlSettings settings_for(const Robot& robot, Law law, Gains gains) {
  ControlSettings settings;
  settings.law = law;
  settings.gains = gains;
  CHECK(place_poles(robot, robot.home, 100, 1, settings));
  return settings;
}
}  // namespace mechanisms
