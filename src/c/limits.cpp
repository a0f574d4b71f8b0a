// Limits of a control cycle for C.
#include "c/controllers.hpp"
#include "control/limit_defaults.hpp"

using namespace truepose;
using namespace truepose::c;

extern "C" {
truepose_outcome truepose_safety_defaults(const truepose_model* model,
                                          const truepose_control_settings* settings,
                                          truepose_safety_limits* limits) {
  return derived(model, settings, limits, default_limits);
}

truepose_outcome truepose_stopping_distance(const truepose_model* model,
                                            const truepose_safety_limits* limits, int32_t marked,
                                            truepose_real speed, truepose_real* distance) {
  return with(model)([&](const Robot& robot) -> Outcome {
    const auto core = in<SafetyLimits>(limits);
    const Outcome outcome = consistent(core, robot.motors, dof(robot.mobility));
    if (!outcome) return outcome;
    if (!(speed >= 0 && speed < INFINITY)) return Status::no_such_value;
    return stopping_distance(robot, core, marked != 0, speed, *distance);
  });
}
}
