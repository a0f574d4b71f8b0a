// What does a redundant sensor read? s(x) and its derivative along the nacelle's free motions.
#pragma once

#include "truepose/pose.hpp"

namespace truepose {

/// Reading of one sensor at a pose: gain s(x) - offset, and its row of J_r (size n).
template <Mobility K>
inline double read(const Sensor& sensor, const Pose& pose, double* row) {
  double value = 0;
  Vec3 linear = Vec3::Zero(), angular = Vec3::Zero();
  switch (sensor.kind) {
    case SensorKind::nacelle_angle:
      value = pose.theta;
      angular.z() = 1;
      break;
    case SensorKind::telemeter: {
      // The line o + s w meets the plane through D + R c with normal R m: m·(D + R c - o - s w) =
      // 0.
      const Vec3 normal = pose.R * sensor.normal;
      const double slope = normal.dot(sensor.direction);
      value = normal.dot(pose.D + pose.R * sensor.target - sensor.origin) / slope;
      linear = normal / slope;
      angular = normal.cross(pose.D - sensor.origin - value * sensor.direction) / slope;
      break;
    }
  }
  free_columns<K>(sensor.gain * linear, sensor.gain * angular, row);
  return sensor.gain * value - sensor.offset;
}

/// The nearest count of an encoder or telemeter (step 0: unquantised).
inline double quantised(double value, double step) {
  return step > 0 ? step * std::nearbyint(value / step) : value;
}

}  // namespace truepose
