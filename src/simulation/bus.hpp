// Latest delivered samples of multirate or delayed sensors.
#pragma once

#include <vector>

#include "control/multirate.hpp"

namespace truepose {
/// Bus between a robot's sensors and its controller, clocked by the controller.
class Bus {
 public:
  explicit Bus(const MultirateSettings& settings) : settings_(settings) {}

  /// Runs one cycle. @param q_e  in: at the sensors, out: at the controller
  /// @return sensors with a new sample, as bits
  std::uint32_t deliver(int motors, Extended& q_e) {
    if (was_.empty()) {  // the robot was at rest before
      was_.assign(kOldest + 1, q_e);
      held_ = q_e;
    }
    was_[at(cycle_)] = q_e;
    const std::uint32_t arrived = arrivals(settings_, cycle_);
    for (int k = 0; k < kMaxSensors && motors + k < kMaxReadings; ++k) {
      if (!settings_.is(k)) continue;
      if (arrived & bit(k))
        held_[motors + k] =
            was_[at(std::max<std::int64_t>(0, cycle_ - settings_.age[k]))][motors + k];
      q_e[motors + k] = held_[motors + k];
    }
    ++cycle_;
    return arrived;
  }

 private:
  static std::size_t at(std::int64_t cycle) { return static_cast<std::size_t>(cycle) & kOldest; }

  MultirateSettings settings_;
  std::int64_t cycle_ = 0;
  std::vector<Extended> was_;  ///< ring of the last cycles
  Extended held_{};
};
}  // namespace truepose
