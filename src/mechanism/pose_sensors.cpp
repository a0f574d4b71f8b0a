// Readings of sensors of the platform's pose: angle, inclinometer, tracker.
#include "mechanism/pose_sensors.hpp"

namespace truepose {
Sensed sense(Is<SensorKind::platform_angle>, const Sensor&, const Pose& pose) {
  Sensed s;
  s.value = pose.theta;
  s.angular.z() = 1;
  return s;
}

Sensed sense(Is<SensorKind::coordinate>, const Sensor& sensor, const Pose& pose) {
  Sensed s;
  const Vec3 arm = pose.R * sensor.target, w = sensor.direction;
  s.value = w.dot(pose.D + arm - sensor.origin);
  s.linear = w;
  s.angular = arm.cross(w);
  s.origin = -w;
  s.direction = pose.D + arm - sensor.origin;
  s.target = pose.R.transpose() * w;
  return s;
}

Sensed sense(Is<SensorKind::inclinometer>, const Sensor& sensor, const Pose& pose) {
  Sensed s;
  const Vec3 vertical = sensor.origin, up = pose.R.transpose() * vertical;
  const Vec3 a = sensor.direction, b = sensor.normal, side = b.cross(a);
  const Real sine = side.dot(up), cosine = b.dot(up), square = sine * sine + cosine * cosine;
  s.value = atan2(sine, cosine);
  const Vec3 by_up = (cosine * side - sine * b) / square;
  // A turn ω of the platform (base frame) changes g' by Rᵀ(z × ω).
  s.angular = (pose.R * by_up).cross(vertical);
  s.origin = pose.R * by_up;
  s.direction = cosine / square * up.cross(b);
  s.normal = (cosine * a.cross(up) - sine * up) / square;
  return s;
}

Sensed sense(Is<SensorKind::rotation>, const Sensor& sensor, const Pose& pose) {
  Sensed s;
  const Vec3 w = log_so3(pose.R), a = sensor.direction;
  const Real angle2 = w.squaredNorm(), half = 0.5 * sqrt(angle2);
  const Real k = angle2 < 1e-6 ? 1.0 / 12 + angle2 / 720 : (1 - half / std::tan(half)) / angle2;
  s.value = a.dot(w);
  s.angular = a - a.cross(w) / 2 + k * w.cross(w.cross(a));
  s.direction = w;
  return s;
}
}  // namespace truepose
