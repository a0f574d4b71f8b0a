// What does Python's watch own? The robot as it understands it, and what is known of it.
#pragma once

#include "known.hpp"
#include "truepose/control/guard.hpp"

namespace truepose::python {

struct Guarding {
  Robot robot;
  Known known;
  GuardSettings settings;

  Guarding(const Robot& watched, const Known& knowledge, const GuardSettings& given)
      : robot(watched), known(knowledge), settings(given) {
    prepare(settings.watch);
  }
};

}  // namespace truepose::python
