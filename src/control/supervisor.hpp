// The hook by which a package watches the fault-tolerant controller: it sees the readings' pose and
// the torques, explains deviations by external forces, and may change the torque of an answer.
#pragma once

#include "control/control.hpp"
#include "control/fault_monitor.hpp"

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
}  // namespace truepose
