// Value and gradients of a redundant sensor, its encoder's errors included.
#pragma once

#include "mechanism/angle_sensors.hpp"
#include "mechanism/length_sensors.hpp"
#include "mechanism/pose_sensors.hpp"

namespace truepose {
/// Whether a sensor is an encoder on a turning shaft.
inline bool rotary(const Sensor& sensor) { return properties(sensor.kind).shaft; }

/// Whether its encoder has an eccentricity error.
inline bool eccentric(const Sensor& sensor) { return sensor.eccentricity.any(); }

/// Applies an encoder's eccentricity to its value and gradients.
void read_off_centre(const Sensor& sensor, Sensed& s);

/// Measured quantity, from a reading.
inline Real measured(const Sensor& sensor, Real reading) {
  const Real value = (reading + sensor.offset) / sensor.gain;
  return eccentric(sensor) ? decode(sensor.eccentricity, value) : value;
}

/// Calls `sense` of a sensor's kind, among the kinds on a chain or the others, and applies its
/// encoder's eccentricity. Compilers make a jump of this chain of comparisons.
/// @param seen  arguments of `sense` after the sensor
template <bool of_chain, int k = 0, class... Seen>
inline Sensed sense_any(const Sensor& sensor, const Seen&... seen) {
  if constexpr (k == kSensorKinds) {
    return {};  // no such kind
  } else if constexpr (kSensorTable[k].of_chain != of_chain) {
    return sense_any<of_chain, k + 1>(sensor, seen...);
  } else {
    if (sensor.kind != kSensorTable[k].kind) return sense_any<of_chain, k + 1>(sensor, seen...);
    Sensed s = sense(Is<kSensorTable[k].kind>{}, sensor, seen...);
    if constexpr (kSensorTable[k].shaft) read_off_centre(sensor, s);
    return s;
  }
}

/// Value and gradients of a sensor of the platform's pose alone.
inline Sensed sense_pose(const Sensor& sensor, const Pose& pose) {
  return sense_any<false>(sensor, pose);
}

/// Whether a sensor reads a chain's motor or rod, not the platform alone.
inline bool on_chain(const Sensor& sensor) { return sensor.chain >= 0; }

/// Whether it reads a rod.
inline bool on_rod(const Sensor& sensor) {
  return on_chain(sensor) && sensor.kind != SensorKind::motor_encoder;
}

/// Value and gradients of a sensor on a chain, at any level of the model.
inline Sensed sense_chain(const Sensor& sensor, const SeenChain& seen) {
  return sense_any<true>(sensor, seen);
}

/// Value of an encoder on a passive axis. @param angles  of the passive axes
Sensed sense_axis(const Sensor& sensor, const Pose& angles);

/// The nearest count of an encoder or telemeter (step 0: unquantized).
inline Real quantized(Real value, Real step) {
  return step > 0 ? step * std::nearbyint(value / step) : value;
}
}  // namespace truepose
