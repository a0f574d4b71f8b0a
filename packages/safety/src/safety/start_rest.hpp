// Consistency of the readings at rest, before a start-up test has any torque.
#pragma once

#include "control/law.hpp"
#include "safety/start_states.hpp"

namespace truepose::start_detail {
/// χ² of the readings at rest, against geometry, counts and noise; infinite beyond a stop, or
/// without a pose. 0 where nothing weighs it.
Real rest_level(const Robot& robot, const SafetyLimits& limits, const Weighing& weighing,
                const Extended& q_e, Pose& pose, int& outside);
}  // namespace truepose::start_detail
