// What does Python's watch own? The robot as it understands it, and what is known of it.
#pragma once

#include <optional>

#include "known.hpp"
#include "late.hpp"
#include "truepose/control/guard.hpp"

namespace truepose::python {

struct Guarding {
  Robot robot;
  Known known;
  GuardSettings settings;
  std::optional<LateSettings> late;  ///< of slow and late sensors, if there are any

  Guarding(const Robot& watched, const Known& knowledge, const GuardSettings& given,
           const std::optional<LateSettings>& slow)
      : robot(watched), known(knowledge), settings(given), late(slow) {
    prepare(settings.watch);
  }
};

}  // namespace truepose::python
