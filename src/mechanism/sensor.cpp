// Value and gradients of a redundant sensor, its encoder's errors included.
#include "mechanism/sensor.hpp"

namespace truepose {
void read_off_centre(const Sensor& sensor, Sensed& s) {
  s.angle = s.value;
  if (!eccentric(sensor)) return;
  const Encoded read = encode(sensor.eccentricity, s.angle);
  s.value = read.value;
  s.slope = read.slope;
  for (Vec3* gradient : {&s.linear, &s.angular, &s.rod, &s.frame, &s.direction, &s.normal})
    *gradient *= read.slope;
}

Sensed sense_axis(const Sensor& sensor, const Pose& angles) {
  Sensed s;
  s.value = angles.D[sensor.axis];
  read_off_centre(sensor, s);
  return s;
}
}  // namespace truepose
