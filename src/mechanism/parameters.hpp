// Derivatives of all readings by all geometric parameters, H_ξ; order and names of ξ.
//
// Two layers: a parameter varies points, directions and lengths of a chain (Variation); the
// readings have derivatives by those (Sensed, the closure). All at fixed pose x, the motors
// following: ∂q/∂ξ, ∂r/∂ξ.
#pragma once

#include <cassert>

#include "mechanism/rkm.hpp"

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
int axis_column(const Robot& robot, int axis);
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
std::array<Real, 6> encoder_reading(const Chain& chain, Real q, const Vec3& p);
/// Returns what a parameter of a chain changes. @param body  orientation of the body that carries A
Variation vary(const Chain& chain, const Vec3& p, const Mat3& body,
               const std::array<Real, 6>& encoder, ChainParameter parameter);

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

/// Derivative by a unit vector, which can only turn.
inline Vec3 turned_only(const Vec3& slope, const Vec3& unit) {
  return slope - slope.dot(unit) * unit;
}

/// Fills the columns of H_ξ of a sensor: offset, gain, mounting.
void sensor_columns(const Robot& robot, int sensor, const Sensed& s, Real* H);

/// Computes H_ξ = ∂[q; r]/∂ξ at a closed pose, (n + r) rows of parameter_count(robot), in the
/// caller's memory. Directions and normals have unit length; else divide their columns by it.
void parameter_jacobian(const Robot& robot, const Closure& closure, Real* H);
}  // namespace truepose
