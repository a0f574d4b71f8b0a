// Readings of sensors of the platform's pose: angle, inclinometer, tracker.
#pragma once

#include "mechanism/sensed.hpp"

namespace truepose {
Sensed sense(Is<SensorKind::platform_angle>, const Sensor&, const Pose& pose);

/// Angle of a passive axis: a coordinate, not a function of D and R; see sensor.hpp.
template <SensorKind joint>
  requires(joint >= SensorKind::axis_angle)
inline Sensed sense(Is<joint>, const Sensor&, const Pose&) {
  return {};
}

/// Coordinate of a platform point along a fixed direction w: w·(D + R t - o).
Sensed sense(Is<SensorKind::coordinate>, const Sensor& sensor, const Pose& pose);

/// Rotation of the platform about its own axis a against gravity, atan2((b×a)·g', b·g'): from its
/// direction b ("up" at zero) to the robot's vertical z as seen from the platform, g' = Rᵀ z.
Sensed sense(Is<SensorKind::inclinometer>, const Sensor& sensor, const Pose& pose);

/// Component a·w of the platform's rotation vector w = log R. With R ← exp(ω) R,
/// dw = ω - (w × ω)/2 + k w × (w × ω), k = (1 - (φ/2) cot(φ/2))/φ².
Sensed sense(Is<SensorKind::rotation>, const Sensor& sensor, const Pose& pose);
}  // namespace truepose
