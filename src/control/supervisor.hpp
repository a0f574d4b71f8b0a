// The hooks for packages in the control cycle. A supervisor of the fault-tolerant controller sees
// the readings' pose and the torques, explains deviations by external forces, and may change the
// torque of an answer. A guard stands between any law and the machine: torques and brakes are its
// own.
#pragma once

#include "control/control.hpp"
#include "control/fault_monitor.hpp"
#include "control/limits.hpp"

// Called in each cycle: it must not allocate, lock or throw, and clang checks that.
#if defined(__has_cpp_attribute)
#if __has_cpp_attribute(clang::nonblocking)
#define TRUEPOSE_BOUNDED [[clang::nonblocking]]
#endif
#endif
#ifndef TRUEPOSE_BOUNDED
#define TRUEPOSE_BOUNDED
#endif

namespace truepose {
/// Cause of an external force.
enum class Disturbance : int {
  none = 0,
  payload = 1,   ///< a mass at D
  friction = 2,  ///< of one motor or of all alike, beyond the modelled one
  contact = 3,   ///< a force on the platform that is neither
};

/// Report on external forces.
struct DisturbanceReport {
  Disturbance disturbance = Disturbance::none;
  int motor = -1;       ///< of friction, from 0; -1: of all motors
  int refused = false;  ///< 1: payload too heavy for the motors: it is not fed forward
  Real size = 0;        ///< kg, N·m (N) of friction, or the norm of the contact's force
  Real sigma = 0;       ///< of a payload or friction
  Real chi2 = 0;        ///< of the residual
  Coordinates force{};  ///< f, external force of the platform's coordinates, N and N·m
};

/// Belongs to one controller; the caller owns it.
class Supervisor {
 public:
  /// Called after the fault monitor and before the law. Sets monitor.pushed, the motors' errors
  /// that external forces cause.
  /// @param moves   whether the law acts @param torque  applied in the last control period
  virtual void observe(const Robot& robot, Real period, bool moves, const Joint& torque,
                       FaultMonitor& monitor) TRUEPOSE_BOUNDED = 0;
  /// Called after an answer of the law. @param torque  in and out
  virtual void answered(const Robot& robot, const Setpoint& setpoint,
                        Joint& torque) TRUEPOSE_BOUNDED = 0;
  virtual const DisturbanceReport& disturbance() const TRUEPOSE_BOUNDED = 0;

 protected:
  ~Supervisor() = default;
};

/// Report of a guard.
struct GuardReport {
  int state = 0;                               ///< the package's
  StopCause cause = StopCause::none;           ///< the first since the acknowledgement,
  int part = -1;                               ///< and its motor or -1
  StopCause refused = StopCause::none;         ///< why a request of this cycle has no effect
  std::uint32_t causes = 0;                    ///< all since the acknowledgement, as bits
  std::uint32_t brakes = bit(kMaxMotors) - 1;  ///< motors whose brakes must hold, as bits
  int follows = false;  ///< 1: the law acts; else it starts anew in each cycle, and no path moves
  int unused = 0;
  Real path_stop = 0;  ///< duration of the stop along the path, s, for PathClock; 0: continue
  Joint torque{};      ///< to the motors
};

/// Belongs to one controller; the caller owns it.
class Guard {
 public:
  std::uint64_t frame = 0;  ///< counter of the readings' frames, where a simulation has one

  /// Called after the law. @param answer  the law's @param state  its torque, ê_q and setpoint
  /// @param monitor  nullptr: none
  virtual void guard(const Robot& robot, const Setpoint& setpoint, const Extended& q_e,
                     Outcome answer, const ControlState& state,
                     const FaultMonitor* monitor) TRUEPOSE_BOUNDED = 0;
  virtual const GuardReport& report() const TRUEPOSE_BOUNDED = 0;
  /// Of a simulated operator before cycle k at rest. @return false: the law acts, or never will
  virtual bool begins(int cycle) = 0;
  /// Switches it off and on.
  virtual void restart() = 0;

 protected:
  ~Guard() = default;
};
}  // namespace truepose
