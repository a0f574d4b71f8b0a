/// @file
/// The control path in one include: no allocation, lock or exception, and bounded steps.
/// Simulation, calibration of logs and prediction are in truepose/offline.hpp.
///
/// Fill a truepose::Robot, pass it to truepose::finish (and truepose::finish_full for the full
/// level) and check the truepose::Outcome. Then call:
///
/// - truepose::ikm, truepose::fkm, truepose::rkm, truepose::jacobian, truepose::tej, and their
///   ..._full with every rod by itself; truepose::command, which refuses other assembly modes
/// - truepose::estimate: the pose of all readings together, with its covariance
/// - truepose::control: one cycle of a controller; truepose::calibrate_online: online calibration
///   by one row of readings
/// - truepose::compensate_latency: present values of slow and delayed sensors
/// - truepose::monitor_faults: faulty readings; truepose::control_fault_tolerant: a controller that
///   continues without them
/// - truepose::control_safely: any of these laws inside the safety shell; truepose::guard: the
/// shell
///   around another controller
/// - truepose::set_parameters: another geometry ξ of the same robot
///
/// Every result is an Outcome or has a Status: check it before using the output.
#pragma once

#include "truepose/control/command.hpp"
#include "truepose/control/fault_tolerant_control.hpp"
#include "truepose/control/joints.hpp"
#include "truepose/control/safe_control.hpp"
#include "truepose/control/start_test.hpp"
#include "truepose/estimation/estimate.hpp"
#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/full/linearise.hpp"
#include "truepose/kinematics/fkm.hpp"
#include "truepose/model/geometry.hpp"
