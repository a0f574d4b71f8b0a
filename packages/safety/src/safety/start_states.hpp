// The start-up test: settings, states, findings.
#pragma once

#include "control/limits.hpp"
#include "control/parity.hpp"
#include "truepose_safety.h"

namespace truepose {
enum class StartState : int {
  rest = 0,     ///< all brakes closed, no torque: readings are averaged and compared
  explain = 1,  ///< they disagree: one miswiring after the other is tried; no torque
  load = 2,     ///< the torque of a pulse builds up against the closed brake
  open = 3,     ///< the motor's brake is released for a few cycles
  close = 4,    ///< it closes, the platform comes to rest, readings are averaged
  judge = 5,    ///< one explanation of all motions after the other is tried
  unload = 6,   ///< the torque goes to zero
  passed = 7,   ///< brakes closed, no torque; the safety shell may start
  failed = 8,   ///< the same, and a finding
};

/// Result of a start that failed.
enum class StartFinding : int {
  none = 0,
  contradictory_limits = 1,  ///< see consistent(); no torque
  unknown_pose = 2,          ///< not referenced, or the readings have no pose; no torque
  missing = 3,               ///< a reading is no number
  moving = 4,                ///< a reading changes at rest; no torque
  out_of_range = 5,          ///< a motor reads beyond its stops; no torque
  inconsistent = 6,          ///< no single miswiring explains the readings, or several do
  reversed = 7,              ///< a reading has the wrong sign (without sensors: or its motor has)
  exchanged = 8,             ///< two readings have each other's place
  frozen = 9,                ///< a reading stands still while others show the motion
  scale = 10,                ///< a reading moves by another amount than the others show
  unseen = 11,               ///< a reading has hardly moved, and is not tested
  no_motion = 12,            ///< a motor: brake, torque or, without sensors, its reading
  no_torque = 13,            ///< a motor sinks by its weight, its torque has no effect
  wrong_way = 14,            ///< a motor turns against its torque, as all readings show
  brake_slips = 15,          ///< a motor moves though its brake is closed
  too_far = 16,              ///< a motor moves farther than a pulse allows
  too_coarse = 17,           ///< a motor: pulses within the bound are below a count, or a cycle
};
inline constexpr std::array kStartFindings{"none",         "contradictory limits",
                                           "unknown pose", "missing reading",
                                           "not at rest",  "range",
                                           "inconsistent", "reversed",
                                           "exchanged",    "frozen",
                                           "scale",        "unseen",
                                           "no motion",    "no torque",
                                           "wrong way",    "brake slips",
                                           "too far",      "too coarse"};

/// Constant during a test; the defaults are assumed. Torque limit and slew, period, brake times,
/// counts and ranges are those of SafetyLimits.
struct StartSettings {
  std::uint32_t size = sizeof(truepose_start_settings);  ///< for the C interface
  int pairs = 4;          ///< of opposite pulses of each motor, beyond those that find its amount;
                          ///< 0: the test ends at rest
  Real motion = 0.5e-3;   ///< of the platform by two opposite pulses, m; at most twice that in all
  Real radius = 0.05;     ///< at which the platform's turns count as motion, m
  Real pulse = 0.006;     ///< wanted time for which a brake is open, s
  Real settle = 0.03;     ///< s, from a closed brake to rest
  Real brake_opens = -1;  ///< s; below 0: as it closes (SafetyLimits::brake)
  Real inertia = 2;       ///< factor by which a motor's may be smaller than the model's
  Real weight = 0.3;      ///< relative error of the weight that a motor holds
  Real false_alarm = 1e-6;  ///< of the readings' consistency at rest
  Joint friction{};         ///< N·m or N (0: the robot's, or 0.5 % of the torque limit)
};

/// Motions of the readings by pulses, and what the model expects.
struct StartEvidence {
  int tested = 0;  ///< motors
  /// Motions forward minus motions back of every reading, by the motor that was pulsed.
  Matrix<kMaxMotors, kMaxReadings> moved{};
  Joint expected{};                     ///< of the motor itself, by the model
  Joint pulses{};                       ///< number of pulses
  Extended variance{};                  ///< of one motion, from counts and noise
  Extended step{};                      ///< count; 0 where noise averages it out
  Matrix<kMaxSensors, kMaxMotors> g{};  ///< J_r J

  /// Variance of reading c's motions by all pulses of motor i. Equal pulses round equally: an
  /// average over more than kRounded of them gains nothing.
  Real noise(int i, int c) const {
    return variance[c] * pulses[i] * std::max(pulses[i] / kRounded, Real(1));
  }
  static constexpr Real kRounded = 24;
};

/// An explanation of the evidence. none: the robot is healthy.
struct StartHypothesis {
  StartFinding kind = StartFinding::none;
  int a = -1, b = -1;  ///< reading or motor; the other reading
};

inline constexpr int kStartHypotheses = 1 + kMaxReadings * (kMaxReadings + 1) / 2 + 2 * kMaxMotors;

/// Report of a test.
struct StartReport {
  StartReport() {
    scale.fill(1);
    sigma.fill(INFINITY);
  }

  StartState state = StartState::rest;
  StartFinding finding = StartFinding::none;
  int part = -1, other = -1;       ///< its reading (of the extended positions) or motor, from 0
  std::uint32_t candidates = 0;    ///< inconsistent: readings that may be miswired, as bits
  std::uint32_t exchangeable = 0;  ///< passed: readings whose exchange would not have been seen
  std::uint32_t brakes = bit(kMaxMotors) - 1;  ///< that must hold, as bits
  int motor = 0;                               ///< that is tested
  Joint torque{};                              ///< to the motors
  Extended scale{}, sigma{};  ///< of every reading, 1: as the others show, and its σ; infinite
                              ///< where nothing has shown it
};

/// State and report, the caller's; a new one starts with closed brakes.
struct StartTest : StartReport {
  Real since = 0;                         ///< time in this state, s
  int index = 0;                          ///< hypothesis of this cycle
  Joint weight{}, push{}, response{};     ///< torques; acceleration of a reading per torque
  Real trim = 0;                          ///< of the weight's torque, forward
  Joint lever{};                          ///< motion of the platform per motion of a reading
  std::array<int, kMaxMotors> longest{};  ///< cycles for which a brake may be open
  int open = 0, side = 1, level = 0;      ///< cycles; direction of the pulse; pairs at this length
  int samples = 0;                        ///< of the average
  Extended sum{}, low{}, high{}, before{}, after{}, begin{}, from{}, forward{}, trimmed{};
  Extended sunk{}, closed{};  ///< motion that stays; readings after the last two opposite pulses
  Extended missing{};         ///< time, s
  StartEvidence evidence;
  std::array<Real, kStartHypotheses> misfit{};
};
}  // namespace truepose
