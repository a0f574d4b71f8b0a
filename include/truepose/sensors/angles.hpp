// Readings of encoders on a chain's joints: elbow, platform-side joint, U-joint, load side.
#pragma once

#include "truepose/sensors/sensed.hpp"

namespace truepose {
/// Direction of the rod ρ = A - B in the frame's plane, from `forward`, positive about `axis` (as
/// q): atan2(side·ρ, forward·ρ); or out of it, positive along `axis`: atan2(axis·ρ, √((forward·ρ)²
/// + (side·ρ)²)). Turning rod and frame together changes nothing, so ∂s/∂frame = ∂s/∂ρ × ρ.
///
/// The frame (forward, side, axis), base frame: at the base side of a revolute chain the arm,
/// u × arm and u; of any other e, u × e and u, fixed in the base. At the platform's side the
/// sensor's own (normal, direction × normal, direction), carried by platform or bar.
inline Sensed sense_rod_angle(const Sensor& sensor, const SeenChain& seen) {
  Sensed s;
  const Mat3& body = seen.body;
  Vec3 forward = seen.chain.zero, axis = seen.chain.axis;
  if (sensor.at_nacelle) {
    forward = body * sensor.normal;
    axis = body * sensor.direction;
  } else if (seen.chain.actuator == Actuator::revolute) {
    forward = seen.p / seen.chain.arm;
  }
  const Vec3 side = axis.cross(forward);
  const Vec3 rod = -seen.v;
  const Real f = forward.dot(rod), w = side.dot(rod), a = axis.dot(rod);
  const Real plane2 = f * f + w * w;
  if (sensor.kind == SensorKind::rod_in_plane) {
    s.value = std::atan2(w, f);
    s.rod = (f * side - w * forward) / plane2;
  } else {
    const Real plane = std::sqrt(plane2);
    s.value = std::atan2(a, plane);
    s.rod = (plane * axis - a / plane * (f * forward + w * side)) / (plane2 + a * a);
  }
  s.frame = s.rod.cross(rod);
  if (sensor.at_nacelle) {  // its mounting: f, w and a differentiated in the body's own axes
    const Vec3 r = body.transpose() * rod;
    const Vec3 by_axis = sensor.normal.cross(r),
               by_forward = r.cross(sensor.direction);  // of w
    if (sensor.kind == SensorKind::rod_in_plane) {
      s.direction = f / plane2 * by_axis;
      s.normal = (f * by_forward - w * r) / plane2;
    } else {
      const Real plane = std::sqrt(plane2), total = plane2 + a * a;
      s.direction = (plane * r - a * w / plane * by_axis) / total;
      s.normal = -a / (plane * total) * (f * r + w * by_forward);
    }
  }
  return s;
}

inline Sensed sense(Is<SensorKind::rod_in_plane>, const Sensor& sensor, const SeenChain& seen) {
  return sense_rod_angle(sensor, seen);
}
inline Sensed sense(Is<SensorKind::rod_lateral>, const Sensor& sensor, const SeenChain& seen) {
  return sense_rod_angle(sensor, seen);
}

/// The motor's position on the load side: the arm's angle, not the motor encoder's reading.
inline Sensed sense(Is<SensorKind::motor_encoder>, const Sensor&, const SeenChain& seen) {
  Sensed s;
  s.value = seen.position;
  s.motor = 1;
  return s;
}
}  // namespace truepose
