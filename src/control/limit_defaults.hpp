// Limits of a control cycle from a robot and its controller, and the distance of a stop.
#pragma once

#include "control/control.hpp"
#include "control/fastest.hpp"
#include "control/limit_check.hpp"

namespace truepose {
/// Position error of an uncalibrated robot, m (the paper's H4: 9 mm). Laws that correct it move the
/// motors off their nominal positions by its image.
inline constexpr Real kUncalibrated = 0.010;
/// Friction of motors whose robot file has none, over their torque limit (assumed).
inline constexpr Real kFriction = 0.03;

/// Limits of a robot whose motors all have a torque limit. Lengths and angles as the motors read,
/// all at home; I_i is motor i's own inertia, ω_i = √(kp_i/I_i) its loop's natural frequency.
///
///     torque      the motor's limit τ_i
///     slew        2 τ_i in 10 ms: the torque of a stop is reached from any other in that time; at
///                 least 2.5 times the loop's answer to a count of all motors, by kp and kd times
///                 the velocity filter's bandwidth (measured: up to 2.3); at most 2 τ_i in a period
///     tracking    τ_i / kp_i: the error by which kp_i alone asks for the whole torque
///     deviation   tracking; laws that correct the geometry: and 10 mm at the platform
///     speed       √(a_i s_i): from rest over half the travel s_i at a_i, the largest acceleration
/// count       one count, and 8 σ of the noise of a difference
///     window      count is at most a tenth of the speed limit over it; 8 ms at most
/// still       three times that: a reading, the measured pace, and the motor's dither by a count
/// rests       count, and the error at which the loops balance the friction of all motors: three
///             times the robot's, 3 % of τ_i where it has none
///     low, high   the stops, as read
///     saturation  5/ω, of the slowest motor: a loop leaves saturation in that time
///     standstill  speed_i I_i / τ_i, the longest: the brake rubs with τ_i (assumed)
///
/// @return no_such_value and the motor without a torque limit or gain
Outcome default_limits(const Robot& robot, const ControlSettings& settings, SafetyLimits& limits);

/// Distance of the reference point, m, from the last fresh frame before a common fault of all
/// readings to standstill, at home, at a speed (m/s; on passive axes rad and rad/s):
///
///     v (t + T)                  t: until the fault is detected; T: until the brakes are told
///     v brake                    the brakes close
///     ½ v² λ max_i(|J_i|/τ_i)    they do the work Σ τ_i |Δq_i|, and |Δx| ≤ Σ |J_i| |Δq_i|
///
/// with λ a bound of the platform's apparent mass, J_i column i of J (its position rows). By one
/// count a loop changes its motor's speed by kd times the count, which adds to v. Frames with a
/// counter or timestamp are detected as `age` allows. Without one, a motor first has to stand still
/// where it should not. Until then the loop takes the setpoint's way v t for an error: the speed
/// grows by kd v t + kp v t²/2. Slower motion is detected later, and the distance may be larger.
/// @param marked  frames carry a counter or timestamp
Outcome stopping_distance(const Robot& robot, const SafetyLimits& limits, bool marked, Real speed,
                          Real& distance);
}  // namespace truepose
