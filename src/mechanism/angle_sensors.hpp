// Readings of encoders on a chain's joints: elbow, platform-side joint, U-joint, load side.
#pragma once

#include "mechanism/sensed.hpp"

namespace truepose {
/// Direction of the rod ρ = A - B in the frame's plane, from `forward`, positive about `axis` (as
/// q): atan2(side·ρ, forward·ρ); or out of it, positive along `axis`: atan2(axis·ρ, √((forward·ρ)²
/// + (side·ρ)²)). Turning rod and frame together changes nothing, so ∂s/∂frame = ∂s/∂ρ × ρ.
///
/// The frame (forward, side, axis), base frame: at the base side of a revolute chain the arm,
/// u × arm and u; of any other e, u × e and u, fixed in the base. At the platform's side the
/// sensor's own (normal, direction × normal, direction), carried by platform or bar.
Sensed sense_rod_angle(const Sensor& sensor, const SeenChain& seen);

template <SensorKind kind>
  requires(kind == SensorKind::rod_in_plane || kind == SensorKind::rod_lateral)
inline Sensed sense(Is<kind>, const Sensor& sensor, const SeenChain& seen) {
  return sense_rod_angle(sensor, seen);
}

/// The motor's position on the load side, the arm's angle: a freedom, see sense_mechanism.hpp.
inline Sensed sense(Is<SensorKind::motor_encoder>, const Sensor&, const SeenChain&) { return {}; }
}  // namespace truepose
