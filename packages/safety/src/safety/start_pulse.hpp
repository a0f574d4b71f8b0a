// Push and opening time of a start-up test's pulses, within the bound of the platform's motion.
#pragma once

#include "safety/start_states.hpp"

namespace truepose::start_detail {
inline constexpr Real kSafe = 0.85;  ///< of the bound, for open brakes
inline constexpr Real kBlind = 5;    ///< pulses' worth of the weight's error until nothing moves
inline constexpr Real kBrakeTurns = 1e-3;   ///< deflection of a closed brake under its motor's
inline constexpr Real kBrakeSlides = 1e-4;  ///< torque limit, rad; of a slide's, m (assumed)
inline constexpr Real kSwings = 2.5;        ///< deflections: under load, when it closes, overshoot
inline constexpr Real kPart = 0.01;         ///< of a cycle, for rounding

/// A motor at the pose at rest.
struct StartMotor {
  Real torque = 0, weight = 0, friction = 0;  ///< limit and absolute values
  Real response = 0;                          ///< acceleration of the motor per torque, absolute
  Real lever = 0;                             ///< motion of the platform per motion of the motor
  bool turns = true;                          ///< revolute
};

struct StartPulse {
  Real push = 0;
  int longest = 0;  ///< cycles for which the brake may be open; 0: none is within the bound
};

/// The push whose longest opening time is a whole number of cycles, as near to the wanted time as
/// torque and brakes allow. The deflection of closed brakes counts as motion, too.
StartPulse pulse_within(const StartSettings& settings, Real period, const StartMotor& motor);
}  // namespace truepose::start_detail
