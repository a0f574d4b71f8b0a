/// @file
/// One include for a machine's controller: everything here is of the control path, which allocates
/// nothing, locks nothing, throws nothing and ends after a bounded number of steps. Simulation,
/// calibration of logs and prediction are in truepose/offline.hpp.
///
/// Fill a truepose::Robot, pass it to truepose::finish (and truepose::finish_full for the level of
/// single rods), look at the truepose::Outcome; then ask it anything:
///
/// - truepose::ikm, truepose::fkm, truepose::rkm, truepose::jacobian, truepose::tej, and their
///   ..._full of every rod by itself; truepose::command, which refuses another assembly mode
/// - truepose::estimate: the pose that all readings together say, with its covariance
/// - truepose::control: one cycle of a controller; truepose::calibrate_online: online
///   calibration by one row of readings
/// - truepose::compensate_latency: what slow and late sensors would read now
/// - truepose::monitor_faults: faulty readings; truepose::control_fault_tolerant: a controller that
///   continues without them
/// - truepose::set_parameters: another geometry ξ of the same robot
///
/// Every answer is an Outcome, or has a Status: nothing may be believed before it was looked at.
#pragma once

#include "truepose/control/command.hpp"
#include "truepose/control/fault_tolerant_control.hpp"
#include "truepose/control/joints.hpp"
#include "truepose/estimation/estimate.hpp"
#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/full/linearise.hpp"
#include "truepose/kinematics/fkm.hpp"
#include "truepose/model/geometry.hpp"
