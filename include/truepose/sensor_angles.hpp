// What do encoders on a chain's joints read? Elbow, nacelle-side joint, U-joint, motor's load side.
#pragma once

#include "truepose/sensed.hpp"

namespace truepose {

/// Frame (forward, side, axis) in which a joint sees its rod ρ, base frame. On the base's side of
/// a revolute chain the arm, u × arm and u; of any other chain e, u × e and u, fixed in the base.
/// On the nacelle's side the sensor's own (normal, direction × normal, direction), carried by the
/// nacelle or by its bar, which keeps its orientation.
struct RodFrame {
  Vec3 forward, side, axis;
};
inline RodFrame rod_frame(const Sensor& sensor, const Chain& chain, const ChainState& state,
                          const Pose& pose) {
  Vec3 forward = chain.zero, axis = chain.axis;
  if (sensor.at_nacelle) {
    const bool turns = chain.bar < 0;
    forward = turns ? Vec3(pose.R * sensor.normal) : sensor.normal;
    axis = turns ? Vec3(pose.R * sensor.direction) : sensor.direction;
  } else if (chain.actuator == Actuator::revolute) {
    forward = state.p / chain.arm;
  }
  return {forward, axis.cross(forward), axis};
}

/// Direction of the rod ρ = A - B in the frame's plane, from `forward`, positive about `axis`
/// (as q): atan2(side·ρ, forward·ρ); or out of it, positive along `axis`:
/// atan2(axis·ρ, √((forward·ρ)² + (side·ρ)²)).
///
/// Turning rod and frame together changes nothing, so ∂s/∂frame = ∂s/∂ρ × ρ.
inline Sensed sense_rod_angle(const Sensor& sensor, const Chain& chain, const ChainState& state,
                              const Pose& pose) {
  Sensed s;
  const RodFrame frame = rod_frame(sensor, chain, state, pose);
  const Vec3 rod = -state.v;
  const double f = frame.forward.dot(rod), w = frame.side.dot(rod), a = frame.axis.dot(rod);
  const double plane2 = f * f + w * w;
  if (sensor.kind == SensorKind::rod_in_plane) {
    s.value = std::atan2(w, f);
    s.rod = (f * frame.side - w * frame.forward) / plane2;
  } else {
    const double plane = std::sqrt(plane2);
    s.value = std::atan2(a, plane);
    s.rod =
        (plane * frame.axis - a / plane * (f * frame.forward + w * frame.side)) / (plane2 + a * a);
  }
  s.frame = s.rod.cross(rod);
  if (sensor.at_nacelle) {  // its mounting: f, w and a differentiated in the body's own axes
    const Vec3 r = chain.bar < 0 ? Vec3(pose.R.transpose() * rod) : rod;
    const Vec3 by_axis = sensor.normal.cross(r), by_forward = r.cross(sensor.direction);  // of w
    if (sensor.kind == SensorKind::rod_in_plane) {
      s.direction = f / plane2 * by_axis;
      s.normal = (f * by_forward - w * r) / plane2;
    } else {
      const double plane = std::sqrt(plane2), total = plane2 + a * a;
      s.direction = (plane * r - a * w / plane * by_axis) / total;
      s.normal = -a / (plane * total) * (f * r + w * by_forward);
    }
  }
  return s;
}

/// The motor's own position, on the load's side: the arm's angle, not the motor encoder's reading.
inline Sensed sense_motor(const Chain& chain, const ChainState& state) {
  Sensed s;
  s.value = state.q + chain.encoder_offset;
  s.motor = 1;
  return s;
}

}  // namespace truepose
