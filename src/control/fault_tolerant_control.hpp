// The fault-tolerant controller: fault monitor, law, stop and brakes.
//
// Laws stay unchanged: they get substitutes for excluded readings and weigh these by nothing. If
// there is no substitute, or the fault is not isolated, the robot stops on its path.
#pragma once

#include "control/limit_check.hpp"
#include "control/supervisor.hpp"

namespace truepose {
/// Time along a path: runs in real time until the robot must stop.
struct PathClock {
  Real time = 0;     ///< s along the path
  Real rate = 1;     ///< d time/dt
  Real slowing = 0;  ///< d rate/dt, 1/s
  Real since = 0;    ///< elapsed share of the stop, 0 to 1

  /// Advances one period. @param stop  duration of the stop, s (may change); 0: continue
  void advance(Real period, Real stop);

  /// The path's setpoint `at`, with rate and acceleration as the clock slows down.
  Setpoint paced(Setpoint at) const;
};

/// Constant during a run.
struct FaultTolerantSettings {
  FaultMonitorSettings monitor;
  const Robot* finest = nullptr;     ///< model for the fault monitor; nullptr: the law's
  Supervisor* supervisor = nullptr;  ///< a package's; nullptr: none
  /// Checks frames, speeds and stuck motors. No other reading reveals a fault common to all of
  /// them.
  bool limited = false;
  SafetyLimits limits{};
};

/// A stop, until acknowledge().
struct PathStop {
  bool stops = false;                 ///< the path must stop,
  Real stop = 0;                      ///< in this time, s, for PathClock::advance(); 0: continue
  std::uint32_t brakes = 0;           ///< motors whose brakes must hold, as bits
  Real unanswered = 0;                ///< time since the last valid torque, s
  Real stopping = 0;                  ///< time since the fault is undecided, s
  LimitState checked;                 ///< of the limits,
  StopCause cause = StopCause::none;  ///< the first that was violated,
  int part = -1;                      ///< and its motor or -1
};

/// State and report of the controller, owned by the caller; a new one starts afresh.
struct FaultTolerantState : PathStop {
  FaultMonitor monitor;
  Coordinates at{};    ///< latest setpoint with a valid cycle
  Joint weight{};      ///< torques that hold the robot there once all brakes are requested, N·m
  bool asked = false;  ///< whether there was a setpoint,
  Joint q_d{};         ///< and the last one, also of a law that starts anew
  Knowledge known{};   ///< with large σ for excluded readings
  FrameMark frame;     ///< in: counter of the readings' frame, if it has one
};

/// Lets the robot move: a new PathClock leads it from where it stands. What the fault monitor still
/// finds stops it again.
inline void release(FaultTolerantState& fault_state) { static_cast<PathStop&>(fault_state) = {}; }

/// Marks a repaired reading as valid and releases the robot.
void acknowledge(FaultTolerantState& fault_state, int reading);

/// σ of an excluded reading, over its own.
inline constexpr Real kDisbelieved = 1e4;

/// Runs one cycle: control() with the readings monitored.
///
/// A motor whose brake is requested follows its feed-forward: it slows down with the others while
/// the brake closes. Once all brakes are requested, the torques hold the robot at rest at its last
/// valid setpoint. No PD acts on these motors before acknowledge().
/// @param fault_state  in and out; the caller must obey `stops` and `brakes`
/// @param late   in and out: slow and delayed sensors; nullptr: none
/// @return as control(); `disagree` and a reading: it is not valid, the robot continues without it
Outcome control_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                               const FaultTolerantSettings& fault_settings,
                               const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                               const Weighing& weighing, FaultTolerantState& fault_state,
                               Multirate* late = nullptr);
}  // namespace truepose
