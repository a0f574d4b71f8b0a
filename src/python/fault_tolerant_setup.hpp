// Settings of Python's fault monitor: the robot at its highest level, and the knowledge of it.
#pragma once

#include <optional>

#include "control/fault_tolerant_control.hpp"
#include "python/known.hpp"
#include "python/multirate.hpp"

namespace truepose::python {
struct FaultTolerantSetup {
  Robot robot;
  Known known;
  FaultTolerantSettings settings;
  std::optional<MultirateSettings> late;  ///< of multirate and delayed sensors, if any

  FaultTolerantSetup(const Robot& monitored, const Known& knowledge,
                     const FaultMonitorSettings& monitor, const MomentumSettings& momentum,
                     const std::optional<MultirateSettings>& slow)
      : robot(monitored), known(knowledge), late(slow) {
    settings.finest = &robot;
    settings.monitor = monitor, settings.momentum = momentum;
    prepare(settings.monitor);
  }
  FaultTolerantSetup(const FaultTolerantSetup&) = delete;
  FaultTolerantSetup& operator=(const FaultTolerantSetup&) = delete;
};
}  // namespace truepose::python
