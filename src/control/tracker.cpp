// Position and rate of a signal that is sampled once a cycle.
#include "control/tracker.hpp"

namespace truepose {
void Tracker::correct(Real period, Real pole, Real innovation) {
  value += period * rate + (1 - pole * pole) * innovation;
  rate += (1 - pole) * (1 - pole) / period * innovation;
}

TrackerGains tracker_gains(Real pole) {
  TrackerGains gains;
  gains.acceleration = 1 / ((1 - pole) * (1 - pole));
  // impulse response: (1 - pole z⁻¹)² h = (1 - z⁻¹)², until it has decayed
  Real before = 0, last = 0;
  for (int k : range(1000)) {
    const Real input = k == 0 ? 1 : k == 1 ? -2 : k == 2 ? 1 : 0;
    const Real h = input + 2 * pole * last - pole * pole * before;
    gains.variance += h * h;
    before = last;
    last = h;
  }
  return gains;
}
}  // namespace truepose
