// Readings of length sensors: telemeter, draw-wire or ball bar, rod length.
#pragma once

#include "truepose/sensors/sensed.hpp"

namespace truepose {
/// Telemeter along the line o + s w, fixed, to the plane of the platform through D + R t with
/// normal R m: (R m)·(D + R t - o - s w) = 0.
inline Sensed sense(Is<SensorKind::plane_distance>, const Sensor& sensor, const Pose& pose) {
  Sensed s;
  const Vec3 normal = pose.R * sensor.normal, arm = pose.R * sensor.target;
  const Real slope = normal.dot(sensor.direction);
  const Vec3 from = pose.D + arm - sensor.origin;
  s.value = normal.dot(from) / slope;
  const Vec3 spot =
      from - s.value * sensor.direction;  // in the plane: from the spot to the target
  s.linear = normal / slope;
  s.angular = normal.cross(spot - arm) / slope;
  s.origin = -s.linear;
  s.direction = -s.value * s.linear;
  s.target = sensor.normal / slope;
  s.normal = pose.R.transpose() * spot / slope;
  return s;
}

/// Draw-wire or ball bar from a point of the base to one of the platform: |D + R t - o|.
inline Sensed sense(Is<SensorKind::distance>, const Sensor& sensor, const Pose& pose) {
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

/// |A - B|: constant over poses for a rod of fixed length, but a measurement of that length.
inline Sensed sense(Is<SensorKind::rod_length>, const Sensor&, const SeenChain& seen) {
  Sensed s;
  s.value = seen.v.norm();
  s.rod = -seen.v / s.value;
  return s;
}
}  // namespace truepose
