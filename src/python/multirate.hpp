// Multirate and delayed sensors for Python: their bus and their state.
#pragma once

#include <optional>
#include <stdexcept>
#include <utility>

#include "simulation/bus.hpp"

namespace truepose::python {
/// Initialises the state of these sensors. @throws std::invalid_argument  invalid period
inline void require_started(const MultirateSettings& settings, Multirate& late) {
  if (!start(settings, late)) throw std::invalid_argument("period or age of a sensor: too long");
}

/// Settings of these sensors in the controller's model, and of the true ones.
using Lateness = std::pair<std::optional<MultirateSettings>, std::optional<MultirateSettings>>;

/// Multirate and delayed sensors of an external plant: bus and state.
struct Slow {
  Multirate late;
  Bus bus;
  bool known_late;
  Knowledge known;

  explicit Slow(const Lateness& lateness)
      : bus(lateness.second.value_or(MultirateSettings{})), known_late(lateness.first) {
    if (known_late) require_started(*lateness.first, late);
  }

  /// Converts sensor readings to those of the controller, (n + r,). Call it once per cycle.
  Extended deliver(int motors, Extended q_e) {
    late.arrived = bus.deliver(motors, q_e);
    return q_e;
  }
  /// @param q_e  in and out @return its weighting
  Weighing compensate_latency(const Robot& robot, const Weighing& weighing, Extended& q_e) {
    if (!known_late) return weighing;
    return compensated(robot, weighing, late, known, q_e);
  }
};
}  // namespace truepose::python
