// Limits of the safety shell. control/safety_defaults.hpp derives them from a robot.
#pragma once

#include "mechanism/robot.hpp"

namespace truepose {
inline constexpr int kMostWindow = 8;     ///< cycles of readings that the shell keeps
inline constexpr Real kReaction = 0.010;  ///< s, from a violation to the torques of the stop

/// Constant during a run. Motors' values in rad or m and N·m or N; times in s.
struct SafetyLimits {
  std::uint32_t size = sizeof(truepose_safety_limits);  ///< for the C interface
  int window = 1;         ///< cycles over which a motor's speed is measured, 1 to kMostWindow
  int age = 2;            ///< periods by which a frame may be older than the freshest one
  int counter_bits = 32;  ///< of the frame counter, 2 to 64: it wraps
  Real period = 1e-3;
  Real saturation = 0.05;    ///< longest time at the torque limit
  Real clipped = kReaction;  ///< longest time at the slew limit
  Real missing = 0.005;      ///< longest time without a motor's reading,
  Real held = 0.005;         ///< and without an answer of the law
  Real stop = 0.15;          ///< duration of a stop along the path
  Real brake = 0.02;         ///< closing and opening time of a brake (assumed)
  Real standstill = 0.05;    ///< longest time from closed brakes to rest
  Joint torque{};            ///< largest
  Joint slew{};              ///< largest change of the torque, per s
  Joint tracking{};          ///< largest error of the law, ê_q
  Joint deviation{};         ///< largest distance of a reading from its setpoint, q_d - q
  Joint speed{};             ///< largest, of motors and setpoints
  Joint count{};             ///< largest error of a difference of two readings: counts, noise
  /// A frozen frame: identical readings of all motors although one should have moved by `still`.
  Joint still{};
  Joint kp{}, kd{};                   ///< 1/s² and 1/s: the loops that move it,
  Joint rests{};                      ///< beyond an error at which a motor may rest
  Joint low{}, high{};                ///< range of the motors' readings (equal: not tested)
  Coordinates box_low{}, box_high{};  ///< range of the setpoint x (equal: not tested)
};

/// Checks limits for contradictions in themselves; `contradiction` of the defaults compares them
/// with a path.
/// @return no_such_value, and the motor; -1: a time, a box or a number of cycles
Outcome consistent(const SafetyLimits& limits, int motors, int freedoms);
}  // namespace truepose
