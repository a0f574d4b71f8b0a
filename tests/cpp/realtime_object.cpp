// The real-time core in one object. Every entry point, compiled with
// neither exceptions nor run-time types; check_symbols.cmake reads its undefined symbols.
#include <cmath>
#undef M_PI  // POSIX's: a library that keeps to C++20 has neither
#undef M_2_SQRTPI

#include "control/command.hpp"
#include "control/safe_control.hpp"
#include "estimation/estimate.hpp"
#include "estimation/online_calibrator.hpp"
#include "mechanism/full_linearise.hpp"

using namespace truepose;

Outcome realtime_finish(Robot& robot) { return finish(robot); }
Outcome realtime_ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm(robot, x, q);
}
Outcome realtime_command(const Robot& robot, const Coordinates& x, Joint& q) {
  return command(robot, x, q);
}
Outcome realtime_command_full(const Robot& robot, const Coordinates& x, Joint& q) {
  return command_full(robot, x, q);
}
Outcome realtime_rkm(const Robot& robot, const Coordinates& x, Reading& r) {
  return rkm(robot, x, r);
}
FkmResult realtime_fkm(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x);
}
Outcome realtime_finish_full(Robot& robot) { return finish_full(robot); }
Outcome realtime_ikm_full(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm_full(robot, x, q);
}
Outcome realtime_rkm_full(const Robot& robot, const Coordinates& x, Reading& r) {
  return rkm_full(robot, x, r);
}
FkmResult realtime_fkm_full(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm_full(robot, q, x);
}
Outcome realtime_jacobian_full(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian_full(robot, x, J);
}
Outcome realtime_linearise(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                           double* H_xi) {
  return linearise(robot, pose, q_e, H_x, H_xi);
}
Outcome realtime_linearise_full(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                                double* H_xi) {
  return linearise_full(robot, pose, q_e, H_x, H_xi);
}
Estimate realtime_estimate(const Robot& robot, const Knowledge& known, const Extended& q_e,
                           Pose& pose, double* work) {
  return estimate(Level::ideal, robot, known, q_e, pose, work);
}
Estimate realtime_estimate_full(const Robot& robot, const Knowledge& known, const Extended& q_e,
                                Pose& pose, double* work) {
  return estimate(Level::full, robot, known, q_e, pose, work);
}
Outcome realtime_parasitic(const Robot& robot, const Coordinates& x, Coordinates& rest) {
  return parasitic(robot, x, rest);
}
Outcome realtime_bring_up(const Robot& robot, Multirate& late, Extended& q_e) {
  const Outcome outcome = compensate_latency(robot, late, q_e);
  low_pass(robot, late, q_e);
  return outcome;
}
Outcome realtime_redundant_fkm(const Robot& robot, const Extended& q_e, Coordinates& x) {
  return redundant_fkm(robot, q_e, x);
}
Outcome realtime_jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian(robot, x, J);
}
Outcome realtime_tej(const Robot& robot, const Coordinates& x, ExtendedColumns& M,
                     ExtendedRows& tej_) {
  return tej(robot, x, M, tej_);
}
Outcome realtime_place_poles(const Robot& robot, const Coordinates& x, ControlSettings& settings) {
  return place_poles(robot, x, 150, 1, settings);
}
Outcome realtime_control(const Robot& robot, const ControlSettings& settings,
                         const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                         const Weighing& weighing) {
  return control(robot, settings, setpoint, q_e, state, weighing);
}
Outcome realtime_monitor(const Robot& robot, const FaultMonitorSettings& settings,
                         const Weighing& weighing, const Joint& desired, const Extended& q_e,
                         FaultMonitor& seen, Extended& believed) {
  return monitor_faults(robot, settings, weighing, desired, q_e, seen, believed);
}
Outcome realtime_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                                const FaultTolerantSettings& fault_settings,
                                const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                                const Weighing& weighing, FaultTolerantState& fault_state) {
  return control_fault_tolerant(robot, settings, fault_settings, setpoint, q_e, state, weighing,
                                fault_state);
}
Outcome realtime_safely(const Robot& robot, const ControlSettings& settings,
                        const SafetyLimits& limits, const Setpoint& setpoint, const Extended& q_e,
                        ControlState& state, SafetyShell& shell, SafetyCycle& cycle,
                        const Weighing& weighing, const Monitored& monitored) {
  return control_safely(robot, settings, limits, setpoint, q_e, state, shell, cycle, weighing,
                        monitored);
}
void realtime_guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
                    SafetyShell& shell) {
  guard(robot, limits, cycle, shell);
}
void realtime_restore(FaultMonitor& seen, int reading) { acknowledge(seen, reading); }
Setpoint realtime_paced(PathClock& clock, double period, double stop, const Setpoint& at) {
  clock.advance(period, stop);
  return clock.paced(at);
}
void realtime_prepare(FaultMonitorSettings& settings) { prepare(settings); }
Outcome realtime_learn(OnlineCalibrator& learner, const Extended& q_e) {
  return calibrate_online(learner, q_e);
}
Outcome realtime_learn_full(OnlineCalibrator& learner, const Extended& q_e) {
  return calibrate_online(Level::full, learner, q_e);
}
double realtime_friction(const Chain& chain, double rate) { return friction(chain, rate); }
Setpoint realtime_quintic(const Coordinates& from, const Coordinates& to, double duration,
                          double time) {
  return quintic(Mobility::spatial, from, to, duration, time);
}
