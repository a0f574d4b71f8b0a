// Simulation of a start-up test: the true robot with brakes, miswired readings.
#pragma once

#include "control/limit_defaults.hpp"
#include "safety/start_test.hpp"
#include "simulation/effects.hpp"
#include "simulation/faults.hpp"

namespace truepose {
/// A simulated start.
struct StartRun {
  std::vector<Fault> faults;
  bool incremental = false;  ///< readings are right at the start: faults act on their changes
  bool referenced = true;    ///< the pose is known
  Coordinates start{};       ///< true pose at rest
  std::uint64_t seed = 0;    ///< of the readings' noise
};

/// The test at its end, and what happened.
struct SimulatedStart {
  StartTest test;
  double moved =
      0;  ///< largest distance of the reference point from the start, m (passive axes: rad)
  Joint torque{};  ///< largest of each motor
  double seconds = 0;
};

/// Runs a start-up test until it passes or fails and the torques are zero.
/// @param robot, weighing  the model, and its tolerances @param limits  as of the safety shell
/// @return the failure of the plant; not_converged: no end within ten minutes
Outcome simulate_start(const Robot& robot, const Robot& truth, const StartSettings& settings,
                       const SafetyLimits& limits, const Weighing& weighing, const Effects& effects,
                       const StartRun& run, SimulatedStart& result);
}  // namespace truepose
