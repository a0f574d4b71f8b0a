// Detection and isolation of faulty readings (FDI).
//
// Single readings are tested in each cycle: a number, within range, no faster than the motors can
// make it, and changing while the robot moves. The parity (parity.hpp) tests all readings together:
// its level and its change (parity_evidence.cpp).
//
// While they disagree, each reading is a hypothesis with log odds (parity_evidence.cpp). One that
// is decisively better than all others is isolated; several alike are suspected together. (Willsky
// and Jones, A generalized likelihood ratio approach to the detection and estimation of jumps in
// linear systems, 1976.)
//
// A faulty reading is substituted: by its own prediction for some cycles, then by the value that
// the others give, its own error taken as unknown. Bounded work, no allocation.
#pragma once

#include "control/fault_monitor_state.hpp"
#include "control/multirate.hpp"

namespace truepose {
/// Runs one cycle.
/// @param weighing  knowledge of the geometry and of the readings' own errors; work space
/// @param desired   q_d, by which frozen motors are detected
/// @param believed  out: the readings, or their substitutes
/// @param late      in and out: slow and delayed sensors, extrapolated here; nullptr: none
/// @return `disagree` and the first reading that is not valid; no answer: the readings give no pose
Outcome monitor_faults(const Robot& robot, const FaultMonitorSettings& settings,
                       const Weighing& weighing, const Joint& desired, const Extended& q_e,
                       FaultMonitor& monitor, Extended& believed, Multirate* late = nullptr);
}  // namespace truepose
