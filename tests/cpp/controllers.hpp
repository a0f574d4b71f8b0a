// Controller settings of the tests.
#pragma once

#include "control/control.hpp"
#include "mechanisms.hpp"

namespace mechanisms {

/// Poles at 100 rad/s, damping 1, placed at home.
ControlSettings settings_for(const Robot& robot, Law law, Gains gains = Gains::diagonal);

}  // namespace mechanisms
