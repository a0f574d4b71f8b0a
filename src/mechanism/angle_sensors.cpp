// Readings of encoders on a chain's joints: elbow, platform-side joint, U-joint, load side.
#include "mechanism/angle_sensors.hpp"

namespace truepose {
Sensed sense_rod_angle(const Sensor& sensor, const SeenChain& seen) {
  Sensed s;
  const Vec3 &rod = seen.rod, &forward = seen.forward, &axis = seen.axis;
  const Vec3 side = axis.cross(forward);
  const Real f = forward.dot(rod), w = side.dot(rod), a = axis.dot(rod);
  const Real plane2 = f * f + w * w;
  if (sensor.kind == SensorKind::rod_in_plane) {
    s.value = atan2(w, f);
    s.rod = (f * side - w * forward) / plane2;
  } else {
    const Real plane = sqrt(plane2);
    s.value = atan2(a, plane);
    s.rod = (plane * axis - a / plane * (f * forward + w * side)) / (plane2 + a * a);
  }
  s.frame = s.rod.cross(rod);
  if (seen.mounted) {  // f, w and a differentiated in the body's own axes
    const Vec3 r = seen.body.transpose() * rod;
    const Vec3 by_axis = sensor.normal.cross(r),
               by_forward = r.cross(sensor.direction);  // of w
    if (sensor.kind == SensorKind::rod_in_plane) {
      s.direction = f / plane2 * by_axis;
      s.normal = (f * by_forward - w * r) / plane2;
    } else {
      const Real plane = sqrt(plane2), total = plane2 + a * a;
      s.direction = (plane * r - a * w / plane * by_axis) / total;
      s.normal = -a / (plane * total) * (f * r + w * by_forward);
    }
  }
  return s;
}
}  // namespace truepose
