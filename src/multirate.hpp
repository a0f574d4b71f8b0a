// Python's slow and delayed sensors: their bus, and what is remembered of them.
#pragma once

#include <optional>
#include <stdexcept>
#include <utility>

#include "truepose/control/law.hpp"
#include "truepose/offline/bus.hpp"

namespace truepose::python {

/// Starts what remembers slow and late readings. @throws std::invalid_argument  no such period
inline void require_started(const MultirateSettings& settings, Multirate& late) {
  if (!start(settings, late)) throw std::invalid_argument("period or age of a sensor: too long");
}

/// Slow and late sensors, as the controller knows them and as they are.
using Lateness = std::pair<std::optional<MultirateSettings>, std::optional<MultirateSettings>>;

/// Slow and late sensors of a plant that is not the core's: its bus, and what is remembered.
struct Slow {
  Multirate late;
  Bus bus;
  bool known_late;
  Knowledge known;

  explicit Slow(const Lateness& lateness)
      : bus(lateness.second.value_or(MultirateSettings{})), known_late(lateness.first) {
    if (known_late) require_started(*lateness.first, late);
  }

  /// As the controller reads it, (n + r,), from the sensors. Once a cycle.
  Extended deliver(int motors, Extended q_e) {
    late.arrived = bus.deliver(motors, q_e);
    return q_e;
  }
  /// @param q_e  in and out @return what is known of it
  Weighing compensate_latency(const Robot& robot, const Weighing& weighing, Extended& q_e) {
    if (!known_late) return weighing;
    const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
      return truepose::compensate_latency<mobility()>(robot, late, q_e);
    });
    if (!outcome) return weighing;
    low_pass(robot, late, q_e);
    if (!weighing) return weighing;
    known = *weighing.known;
    weigh(robot, late, known);
    return {&known, weighing.work};
  }
};

}  // namespace truepose::python
