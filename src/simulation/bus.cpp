// Latest delivered samples of multirate or delayed sensors.
#include "simulation/bus.hpp"

namespace truepose {
std::uint32_t Bus::deliver(int motors, Extended& q_e) {
  if (was_.empty()) {  // the robot was at rest before
    was_.assign(kOldest + 1, q_e);
    held_ = q_e;
  }
  was_[at(cycle_)] = q_e;
  const std::uint32_t arrived = arrivals(settings_, cycle_);
  for (int k = 0; k < kMaxSensors && motors + k < kMaxReadings; ++k) {
    if (!settings_.is(k)) continue;
    if (arrived & bit(k))
      held_[motors + k] = was_[at(max<std::int64_t>(0, cycle_ - settings_.age[k]))][motors + k];
    q_e[motors + k] = held_[motors + k];
  }
  ++cycle_;
  return arrived;
}
}  // namespace truepose
