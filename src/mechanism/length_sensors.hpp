// Readings of length sensors: telemeter, draw-wire or ball bar, rod length.
#pragma once

#include "mechanism/sensed.hpp"

namespace truepose {
/// Telemeter along the line o + s w, fixed, to the plane of the platform through D + R t with
/// normal R m: (R m)·(D + R t - o - s w) = 0.
Sensed sense(Is<SensorKind::plane_distance>, const Sensor& sensor, const Pose& pose);

/// Draw-wire or ball bar from a point of the base to one of the platform: |D + R t - o|.
Sensed sense(Is<SensorKind::distance>, const Sensor& sensor, const Pose& pose);

/// |A - B|: constant over poses for a rod of fixed length, but a measurement of that length.
Sensed sense(Is<SensorKind::rod_length>, const Sensor&, const SeenChain& seen);
}  // namespace truepose
