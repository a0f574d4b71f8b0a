// The members of the structs of truepose_safety.h that are the package's, by name.
#pragma once

#include "c/fields.hpp"
#include "safety/momentum_observer.hpp"
#include "safety/start_states.hpp"

namespace truepose::c {
TRUEPOSE_TABLE(truepose_start_settings, StartSettings, size, pairs, motion, radius, pulse, settle,
               brake_opens, inertia, weight, false_alarm, friction)
TRUEPOSE_TABLE(truepose_start_report, StartReport, state, finding, part, other, candidates,
               exchangeable, brakes, motor, torque, scale, sigma)
TRUEPOSE_TABLE(truepose_momentum_settings, MomentumSettings, size, carry, period, bandwidth, alarm,
               share, named, kept, window, over, sigma, give)
TRUEPOSE_TABLE(truepose_safety_report, GuardReport, state, cause, part, refused, causes, brakes,
               follows, unused, path_stop, torque)
TRUEPOSE_TABLE(truepose_disturbance, DisturbanceReport, kind, motor, refused, size, sigma, chi2,
               force)
}  // namespace truepose::c
