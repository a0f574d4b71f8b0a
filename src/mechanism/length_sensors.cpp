// Readings of length sensors: telemeter, draw-wire or ball bar, rod length.
#include "mechanism/length_sensors.hpp"

namespace truepose {
Sensed sense(Is<SensorKind::plane_distance>, const Sensor& sensor, const Pose& pose) {
  Sensed s;
  const Vec3 normal = pose.R * sensor.normal, arm = pose.R * sensor.target;
  const Real slope = normal.dot(sensor.direction);
  const Vec3 from = pose.D + arm - sensor.origin;
  s.value = normal.dot(from) / slope;
  const Vec3 spot = from - s.value * sensor.direction;  // in the plane: from the spot to the target
  s.linear = normal / slope;
  s.angular = normal.cross(spot - arm) / slope;
  s.origin = -s.linear;
  s.direction = -s.value * s.linear;
  s.target = sensor.normal / slope;
  s.normal = pose.R.transpose() * spot / slope;
  return s;
}

Sensed sense(Is<SensorKind::distance>, const Sensor& sensor, const Pose& pose) {
  Sensed s;
  const Vec3 arm = pose.R * sensor.target, from = pose.D + arm - sensor.origin;
  s.value = from.norm();
  const Vec3 along = from / s.value;
  s.linear = along;
  s.angular = arm.cross(along);
  s.origin = -along;
  s.target = pose.R.transpose() * along;
  return s;
}

Sensed sense(Is<SensorKind::rod_length>, const Sensor&, const SeenChain& seen) {
  Sensed s;
  s.value = seen.rod.norm();
  s.rod = seen.rod / s.value;
  return s;
}
}  // namespace truepose
