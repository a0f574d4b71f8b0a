// The last sample to arrive of slow or delayed sensors, held.
#pragma once

#include <vector>

#include "truepose/control/multirate.hpp"

namespace truepose {

/// Between a robot's sensors and its controller. Samples are taken by the controller's clock.
class Bus {
 public:
  explicit Bus(const MultirateSettings& settings) : settings_(settings) {}

  /// One cycle. @param q_e  in: as the sensors have it, out: as the controller reads it
  /// @return sensors of which a sample has just arrived, as bits
  std::uint32_t deliver(int motors, Extended& q_e) {
    if (was_.empty()) {  // a robot that stood still
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
