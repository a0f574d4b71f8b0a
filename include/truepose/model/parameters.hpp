// Derivatives of all readings by all geometric parameters, H_ξ; order and names of ξ.
//
// Two layers: a parameter varies points, directions and lengths of a chain (Variation); the
// readings have derivatives by those (Sensed, the closure). All at fixed pose x, the motors
// following: ∂q/∂ξ, ∂r/∂ξ.
#pragma once

#include <cassert>

#include "truepose/sensors/rkm.hpp"

namespace truepose {
/// A parameter's name within its part, and its unit.
struct ParameterProperties {
  const char* name;
  Unit unit;
};

// Lists of parameters, ENTRY(enumerator, name, unit) each, from which enumeration and table follow.
#define TRUEPOSE_VECTOR(ENTRY, vector, unit) \
  ENTRY(vector##_x, #vector ".x", unit)      \
  ENTRY(vector##_y, #vector ".y", unit)      \
  ENTRY(vector##_z, #vector ".z", unit)
#define TRUEPOSE_ECCENTRICITY(ENTRY)                \
  ENTRY(eccentricity_c1, "eccentricity.c1", radian) \
  ENTRY(eccentricity_s1, "eccentricity.s1", radian) \
  ENTRY(eccentricity_c2, "eccentricity.c2", radian) \
  ENTRY(eccentricity_s2, "eccentricity.s2", radian)
#define TRUEPOSE_CHAIN_PARAMETERS(ENTRY)           \
  TRUEPOSE_VECTOR(ENTRY, base, metre)              \
  ENTRY(arm, "arm", metre)                         \
  ENTRY(rod, "rod", metre)                         \
  ENTRY(encoder_offset, "encoder_offset", reading) \
  ENTRY(yaw, "yaw", radian)                        \
  ENTRY(tilt, "tilt", radian)                      \
  TRUEPOSE_VECTOR(ENTRY, anchor, metre)            \
  ENTRY(rod_difference, "rod_difference", metre)   \
  ENTRY(rod_spacing, "rod_spacing", metre)         \
  TRUEPOSE_ECCENTRICITY(ENTRY)                     \
  ENTRY(encoder_gain, "gain", one)                 \
  ENTRY(encoder_buildup, "spool_buildup", one)
#define TRUEPOSE_SENSOR_PARAMETERS(ENTRY) \
  ENTRY(offset, "offset", reading)        \
  ENTRY(gain, "gain", one)                \
  TRUEPOSE_VECTOR(ENTRY, origin, metre)   \
  TRUEPOSE_VECTOR(ENTRY, direction, one)  \
  TRUEPOSE_VECTOR(ENTRY, target, metre)   \
  TRUEPOSE_VECTOR(ENTRY, normal, one)     \
  TRUEPOSE_ECCENTRICITY(ENTRY)
#define TRUEPOSE_AXIS_PARAMETERS(ENTRY) \
  TRUEPOSE_VECTOR(ENTRY, origin, metre) \
  TRUEPOSE_VECTOR(ENTRY, direction, one)
#define TRUEPOSE_ENUMERATOR(enumerator, name, unit) enumerator,
#define TRUEPOSE_ROW(enumerator, name, unit) ParameterProperties{name, Unit::unit},

/// Parameters of a chain, in this order. A telescopic chain has no arm and no rod; rod_difference
/// and rod_spacing change readings at the full level only; encoder_buildup is last, so that arms
/// can omit it.
enum class ChainParameter : int { TRUEPOSE_CHAIN_PARAMETERS(TRUEPOSE_ENUMERATOR) };
/// Parameters of a sensor, in this order; those that its kind lacks have zero columns.
enum class SensorParameter : int { TRUEPOSE_SENSOR_PARAMETERS(TRUEPOSE_ENUMERATOR) };
/// Parameters of a passive axis, in this order.
enum class AxisParameter : int { TRUEPOSE_AXIS_PARAMETERS(TRUEPOSE_ENUMERATOR) };

inline constexpr std::array kChainTable{TRUEPOSE_CHAIN_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr std::array kSensorParameterTable{TRUEPOSE_SENSOR_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr std::array kAxisTable{TRUEPOSE_AXIS_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr int kChainParameters = static_cast<int>(kChainTable.size());
inline constexpr int kSensorParameters = static_cast<int>(kSensorParameterTable.size());
inline constexpr int kAxisParameters = static_cast<int>(kAxisTable.size());

/// ξ: chains, then c of the bars, the sensors in use, and the passive axes.
inline int parameter_count(const Robot& robot) {
  return robot.chains * kChainParameters + kMaxBars + robot.r * kSensorParameters +
         passive_axes(robot.mobility) * kAxisParameters;
}
inline int axis_column(const Robot& robot, int axis) {
  assert(axis >= 0 && axis < passive_axes(robot.mobility));
  return robot.chains * kChainParameters + kMaxBars + robot.r * kSensorParameters +
         axis * kAxisParameters;
}
inline int chain_column(int chain) { return chain * kChainParameters; }
inline int bar_column(const Robot& robot, int bar) {
  assert(bar >= 0 && bar < kMaxBars);  // else it is a sensor's column: see parts_exist
  return robot.chains * kChainParameters + bar;
}
inline int sensor_column(const Robot& robot, int sensor) {
  assert(sensor >= 0 && sensor < robot.r);
  return robot.chains * kChainParameters + kMaxBars + sensor * kSensorParameters;
}

/// What a parameter changes, at fixed pose and fixed encoder reading.
struct Variation {
  Vec3 B = Vec3::Zero(), A = Vec3::Zero();
  Vec3 turn = Vec3::Zero();  ///< of the frame e, u×e, u at the motor
  Real rod = 0;              ///< L
  Real motor = 0;            ///< the motor's angle or position, in units of its reading
  Real difference = 0;       ///< δ between the rods of a pair (full level)
  Real spacing = 0;          ///< s between them
};

/// ∂q of a motor at rest with its arm at p, by the encoder's amplitudes, gain and build-up. The
/// gain scales from 0, with whole turns left out of q as in the models.
inline std::array<Real, 6> encoder_reading(const Chain& chain, Real q, const Vec3& p) {
  const Real v = (q + chain.encoder_offset) / chain.encoder_gain;
  std::array<Real, 6> change{0, 0, 0, 0, v, 0};
  if (chain.actuator != Actuator::revolute) {
    change[5] = -chain.encoder_gain * v * v / (1 + 2 * chain.encoder_buildup * v);
    return change;
  }
  const Real position = std::atan2(chain.axis.cross(chain.zero).dot(p), chain.zero.dot(p));
  const std::array<Real, 4> harmonic = harmonics(chain.eccentricity, position);
  for (int k = 0; k < 4; ++k)
    change[k] = chain.encoder_gain * harmonic[k] / chain.eccentricity.gear;
  return change;
}
/// Returns what a parameter of a chain changes. @param body  orientation of the body that carries A
inline Variation vary(const Chain& chain, const Vec3& p, const Mat3& body,
                      const std::array<Real, 6>& encoder, ChainParameter parameter) {
  Variation change;
  const auto unit = [&](ChainParameter first) -> Vec3 {
    return Vec3::Unit(static_cast<int>(parameter) - static_cast<int>(first));
  };
  switch (parameter) {
    case ChainParameter::base_x:
    case ChainParameter::base_y:
    case ChainParameter::base_z: change.B = unit(ChainParameter::base_x); break;
    case ChainParameter::arm:
      if (chain.actuator == Actuator::revolute) change.B = p / chain.arm;
      break;
    case ChainParameter::rod: change.rod = chain.actuator == Actuator::telescopic ? 0 : 1; break;
    case ChainParameter::encoder_offset: change.motor = 1; break;
    case ChainParameter::yaw: change.turn = Vec3::UnitZ(); break;  // adds to α
    case ChainParameter::tilt: change.turn = chain.zero; break;  // turns u about e
    case ChainParameter::anchor_x:
    case ChainParameter::anchor_y:
    case ChainParameter::anchor_z: change.A = body * unit(ChainParameter::anchor_x); break;
    case ChainParameter::rod_difference: change.difference = 1; break;
    case ChainParameter::rod_spacing: change.spacing = 1; break;
    case ChainParameter::eccentricity_c1:
    case ChainParameter::eccentricity_s1:
    case ChainParameter::eccentricity_c2:
    case ChainParameter::eccentricity_s2:
    case ChainParameter::encoder_gain:
    case ChainParameter::encoder_buildup:
      change.motor = -encoder[static_cast<std::size_t>(parameter) -
                              static_cast<std::size_t>(ChainParameter::eccentricity_c1)];
      break;
  }
  if (parameter == ChainParameter::yaw || parameter == ChainParameter::tilt)
    change.B = change.turn.cross(p);
  return change;
}

/// Calls enter(column of H_ξ, variation) for each parameter of chain i. @param lever  R c
template <class Enter>
inline void for_each_variation(const Robot& robot, int i, Real q, const Vec3& p, const Mat3& body,
                               const Vec3& lever, Enter&& enter) {
  const Chain& chain = robot.chain[i];
  const std::array<Real, 6> encoder = encoder_reading(chain, q, p);
  const int count = kChainParameters - (chain.actuator == Actuator::revolute);
  for (int k = 0; k < count; ++k)
    enter(chain_column(i) + k, vary(chain, p, body, encoder, static_cast<ChainParameter>(k)));
  if (chain.bar >= 0) {  // c moves along itself
    Variation change;
    change.A = lever.normalized();
    enter(bar_column(robot, chain.bar), change);
  }
}

/// ∂f of a rod, f = (|v|² - L²)/2, at a fixed motor reading. @param jq  ∂f/∂q
inline Real closure_change(const Vec3& v, Real jq, Real length, const Variation& change) {
  return v.dot(change.B - change.A) + jq * change.motor - length * change.rod;
}

/// ∂s of a sensor on the chain, at a fixed motor reading.
inline Real sensor_change(const Sensor& sensor, const Sensed& s, const Chain& chain, const Vec3& dB,
                          Real rate, const Variation& change) {
  const Real turned = sensor.at_nacelle ? 0 : s.frame.dot(change.turn);
  return s.rod.dot(change.A - change.B) + turned +
         by_motor(sensor, s, chain, dB, rate) * change.motor;
}

/// Derivative by a unit vector, which can only turn.
inline Vec3 turned_only(const Vec3& slope, const Vec3& unit) {
  return slope - slope.dot(unit) * unit;
}

/// Fills the columns of H_ξ of the sensors: offset, gain, mounting.
inline void sensor_columns(const Robot& robot, const std::array<Sensed, kMaxSensors>& sensed,
                           Real* H) {
  const int n = dof(robot.mobility), width = parameter_count(robot);
  for (int k = 0; k < robot.r; ++k) {
    Real* row = H + (n + k) * width + sensor_column(robot, k);
    const Sensed& s = sensed[k];
    row[static_cast<int>(SensorParameter::offset)] = -1;
    row[static_cast<int>(SensorParameter::gain)] = s.value;
    int column = static_cast<int>(SensorParameter::origin_x);
    const Sensor& sensor = robot.sensor[k];
    const Vec3 direction = turned_only(s.direction, sensor.direction);
    const Vec3 normal = turned_only(s.normal, sensor.normal);
    for (const Vec3* vector : {&s.origin, &direction, &s.target, &normal})
      for (int axis = 0; axis < 3; ++axis) row[column++] = sensor.gain * (*vector)[axis];
    if (!rotary(robot.sensor[k])) continue;
    const Eccentricity& encoder = robot.sensor[k].eccentricity;
    for (const Real harmonic : harmonics(encoder, s.angle))
      row[column++] = robot.sensor[k].gain * harmonic / encoder.gear;
  }
}

/// Fills H_ξ except for passive axes. @param states  of the n chains
inline void parameter_jacobian(const Robot& robot, const Pose& pose, const ChainState* states,
                               const std::array<Sensed, kMaxSensors>& sensed, Real* H) {
  const int n = dof(robot.mobility), width = parameter_count(robot);
  std::fill(H, H + (n + robot.r) * width, 0.0);
  for (int i = 0; i < n; ++i) {
    const Chain& chain = robot.chain[i];
    const ChainState& state = states[i];
    const Mat3 body = body_of(chain, pose);
    for_each_variation(
        robot, i, state.q, state.p, body, state.lever, [&](int column, const Variation& change) {
          const Real motor = -closure_change(state.v, state.jq, chain.rod, change) / state.jq;
          H[i * width + column] += motor;
          for (int k = 0; k < robot.r; ++k) {
            const Sensor& sensor = robot.sensor[k];
            if (sensor.chain != i) continue;
            const Real by_q = by_motor(sensor, sensed[k], chain, state.dB, state.rate);
            H[(n + k) * width + column] +=
                sensor.gain *
                (sensor_change(sensor, sensed[k], chain, state.dB, state.rate, change) +
                 by_q * motor);
          }
        });
  }
  sensor_columns(robot, sensed, H);
}

/// Fills the columns of H_ξ of the passive axes. Each parameter moves the platform by a twist, the
/// angles held: an origin shifts all that follows it; a direction turned by δ ⟂ d turns it by
/// sin x δ + (1 - cos x) d × δ about the axis' origin. The readings follow as for any motion.
inline void axis_columns([[maybe_unused]] const Robot& robot,
                         [[maybe_unused]] const Closure& closure,
                         [[maybe_unused]] const std::array<Sensed, kMaxSensors>& sensed,
                         [[maybe_unused]] Real* H) {
  if (is_rotational(robot.mobility)) {
    const int n = dof(robot.mobility);
    const int width = parameter_count(robot);
    Mat3 R = Mat3::Identity();  // of the preceding axis
    for (int j = 0; j < n; ++j) {
      const Vec3 d = robot.axis[j].direction;
      const Real c = std::cos(closure.pose.D[j]), s = std::sin(closure.pose.D[j]);
      for (int k = 0; k < kAxisParameters; ++k) {
        Vec3 linear = R.col(k % 3), angular = Vec3::Zero();
        if (k >= static_cast<int>(AxisParameter::direction_x)) {
          const Vec3 turned = turned_only(Vec3::Unit(k % 3), d);
          angular = R * (s * turned + (1 - c) * d.cross(turned));
          linear = angular.cross(closure.carried.arm[j]);
        }
        Coordinates motor;
        for (int i = 0; i < n; ++i) {
          const ChainState& state = closure.chain[i];
          motor[i] = state.v.dot(linear + angular.cross(state.lever)) / state.jq;
          H[i * width + axis_column(robot, j) + k] = motor[i];
        }
        for (int m = 0; m < robot.r; ++m) {
          const Sensor& sensor = robot.sensor[m];
          const Sensed& of = sensed[m];
          Real change = of.linear.dot(linear) + of.angular.dot(angular);
          if (on_chain(sensor)) {
            const Chain& chain = robot.chain[sensor.chain];
            const ChainState& state = closure.chain[sensor.chain];
            const bool carried = sensor.at_nacelle && chain.bar < 0;
            change = of.rod.dot(linear + angular.cross(state.lever)) +
                     (carried ? of.frame.dot(angular) : 0) +
                     by_motor(sensor, of, chain, state.dB, state.rate) * motor[sensor.chain];
          }
          H[(n + m) * width + axis_column(robot, j) + k] = sensor.gain * change;
        }
      }
      R = R * exp_so3(closure.pose.D[j] * d);
    }
  }
}

/// Computes H_ξ = ∂[q; r]/∂ξ at a closed pose, (n + r) rows of parameter_count(robot), in the
/// caller's memory. Directions and normals have unit length; else divide their columns by it.
inline void parameter_jacobian(const Robot& robot, const Closure& closure, Real* H) {
  std::array<Sensed, kMaxSensors> sensed;
  for (int k = 0; k < robot.r; ++k) sensed[k] = sense(robot, robot.sensor[k], closure);
  parameter_jacobian(robot, closure.placed(), closure.chain.data(), sensed, H);
  axis_columns(robot, closure, sensed, H);
}
}  // namespace truepose
