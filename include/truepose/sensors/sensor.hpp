// Reading of a redundant sensor and its derivative by the pose: s(x), J_r.
#pragma once

#include "truepose/kinematics/jacobian.hpp"
#include "truepose/sensors/angles.hpp"
#include "truepose/sensors/lengths.hpp"
#include "truepose/sensors/pose.hpp"

namespace truepose {
/// Whether a sensor is an encoder on a turning shaft.
inline bool rotary(const Sensor& sensor) { return properties(sensor.kind).shaft; }

/// Whether its encoder has an eccentricity error.
inline bool eccentric(const Sensor& sensor) { return sensor.encoder_errs; }

/// Applies an encoder's eccentricity to its value and gradients.
inline void read_off_centre(const Sensor& sensor, Sensed& s) {
  s.angle = s.value;
  if (!eccentric(sensor)) return;
  const Encoded read = encode(sensor.eccentricity, s.angle);
  s.value = read.value;
  s.slope = read.slope;
  for (Vec3* gradient : {&s.linear, &s.angular, &s.rod, &s.frame, &s.direction, &s.normal})
    *gradient *= read.slope;
  s.motor *= read.slope;
}

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

/// Value and gradients of a sensor on a chain, at any level of the model.
inline Sensed sense_chain(const Sensor& sensor, const SeenChain& seen) {
  return sense_any<true>(sensor, seen);
}

/// Orientation of the body that carries a chain's A: bars keep theirs.
inline Mat3 body_of(const Chain& chain, const Pose& pose) {
  return chain.bar < 0 ? pose.R : Mat3(Mat3::Identity());
}

/// Value of an encoder on a passive axis. @param angles  of the passive axes
inline Sensed sense_axis(const Sensor& sensor, const Pose& angles) {
  Sensed s;
  s.value = angles.D[sensor.axis];
  read_off_centre(sensor, s);
  return s;
}

/// Value and gradients of any sensor at a closed pose.
inline Sensed sense(const Robot& robot, const Sensor& sensor, const Closure& closure) {
  if (sensor.kind == SensorKind::axis_angle) return sense_axis(sensor, closure.pose);
  if (!on_chain(sensor)) return sense_pose(sensor, closure.placed());
  const Chain& chain = robot.chain[sensor.chain];
  const ChainState& state = closure.chain[sensor.chain];
  return sense_chain(sensor, {chain, motor_position(chain, state.q), state.p, state.v,
                              body_of(chain, closure.placed())});
}

/// ∂s/∂q of the sensor's chain with the platform held: the motor moves B, and turns the arm, the
/// reference of a base-side joint.
/// @param dB    ∂B/∂q
/// @param rate  ∂position/∂q
inline Real by_motor(const Sensor& sensor, const Sensed& s, const Chain& chain, const Vec3& dB,
                     Real rate) {
  const bool on_arm = !sensor.at_nacelle && chain.actuator == Actuator::revolute;
  return (s.motor + (on_arm ? s.frame.dot(chain.axis) : 0.0)) * rate - s.rod.dot(dB);
}

/// Row of J_r without the gain: ds along the platform's free motions, the motors following.
inline void sensor_row(const Robot& robot, const Sensor& sensor, const Closure& closure,
                       const Sensed& s, Real* row) {
  if (sensor.kind == SensorKind::axis_angle) {
    for (int j = 0; j < dof(robot.mobility); ++j) row[j] = j == sensor.axis ? s.slope : 0;
    return;
  }
  if (!on_chain(sensor)) {
    free_row(closure.carried, s.linear, s.angular, row);
    return;
  }
  const Chain& chain = robot.chain[sensor.chain];
  const ChainState& state = closure.chain[sensor.chain];
  // A moves with the platform; so does the frame of a joint on the platform itself.
  const Vec3 turn = sensor.at_nacelle && chain.bar < 0 ? s.frame : Vec3::Zero();
  free_row(closure.carried, s.rod, state.lever.cross(s.rod) + turn, row);
  Coordinates jx;
  jx_row(closure.carried, state.v, state.lever, jx.data());
  const Real scale = by_motor(sensor, s, chain, state.dB, state.rate) / state.jq;
  for (int j = 0; j < dof(robot.mobility); ++j) row[j] += scale * jx[j];
}

/// Reading of any sensor at a closed pose, gain s - offset, and its row of J_r (size n).
inline Real any_reading(const Robot& robot, const Sensor& sensor,
                                       const Closure& closure, Real* row) {
  const Sensed s = sense(robot, sensor, closure);
  sensor_row(robot, sensor, closure, s, row);
  for (int j = 0; j < dof(robot.mobility); ++j) row[j] *= sensor.gain;
  return sensor.gain * s.value - sensor.offset;
}

/// The same, with a shortcut for the paper's θ sensor.
inline Real sensor_reading(const Robot& robot, const Sensor& sensor, const Closure& closure,
                           Real* row) {
  if (sensor.kind != SensorKind::platform_angle || eccentric(sensor))
    return any_reading(robot, sensor, closure, row);
  free_row(closure.carried, Vec3::Zero(), Vec3(0, 0, sensor.gain), row);
  return sensor.gain * closure.pose.theta - sensor.offset;
}

/// The nearest count of an encoder or telemeter (step 0: unquantized).
inline Real quantized(Real value, Real step) {
  return step > 0 ? step * std::nearbyint(value / step) : value;
}
}  // namespace truepose
