// The start-up test: proves every reading before a law may act.
//
// At rest, all brakes closed and without torque, the readings must be consistent. Then one brake at
// a time is opened for a few milliseconds under a constant torque, the weight's and a push forward
// or back. Brakes and torques bound the motion, no reading does:
//
//     |Δx| ≤ ½ |J_i| T² (|push| + |weight's error|) k/I_i      I_i: (JᵀMJ)_ii, k: 2
//
// for each opening, and the push and the longest T are such that all motion of a motor that no
// reading shows stays below 2·motion. T begins at a quarter of that and grows while little moves.
// The sum of opposite motions trims the weight's torque, their difference is the evidence
// (start_evidence.hpp): sign, scale, exchange, freezing, brakes.
//
// Bounded work, no allocation, exception or lock. Torques pass the slew and torque limits; no NaN
// reaches a motor.
#pragma once

#include "control/law.hpp"
#include "safety/start_evidence.hpp"

namespace truepose {
/// Runs one cycle of the start-up test: torques and brakes are test.torque and test.brakes. Call it
/// in every cycle until test.state is `passed` or `failed` and the torques are 0.
/// @param known  the motors are referenced
/// @param weighing  tolerances of the geometry, for the consistency at rest; empty: not tested
void start_test(const Robot& robot, const StartSettings& settings, const SafetyLimits& limits,
                const Extended& q_e, bool known, StartTest& test, const Weighing& weighing = {});
}  // namespace truepose
