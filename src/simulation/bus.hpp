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
  std::uint32_t deliver(int motors, Extended& q_e);

 private:
  static std::size_t at(std::int64_t cycle) { return std::size_t(cycle) & kOldest; }

  MultirateSettings settings_;
  std::int64_t cycle_ = 0;
  std::vector<Extended> was_;  ///< ring of the last cycles
  Extended held_{};
};
}  // namespace truepose
