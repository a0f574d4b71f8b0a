// Derivatives of all readings by all geometric parameters, H_ξ; order and names of ξ.
//
// A parameter displaces frames, points or lengths of a mechanism; the readings and closures have
// derivatives by those. All at fixed pose x, the motors following: ∂q/∂ξ, ∂r/∂ξ.
#pragma once

#include <cassert>

#include "mechanism/rkm.hpp"
#include "mechanism/sense_mechanism.hpp"

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
#define TRUEPOSE_AXIS_PARAMETERS(ENTRY)  \
  TRUEPOSE_VECTOR(ENTRY, origin, metre)  \
  TRUEPOSE_VECTOR(ENTRY, direction, one) \
  ENTRY(zero, "zero", reading)
#define TRUEPOSE_CLOSURE_PARAMETERS(ENTRY) \
  TRUEPOSE_VECTOR(ENTRY, anchor, metre)    \
  TRUEPOSE_VECTOR(ENTRY, base, metre)      \
  ENTRY(length, "length", metre)           \
  TRUEPOSE_VECTOR(ENTRY, base_hinge, one)  \
  TRUEPOSE_VECTOR(ENTRY, anchor_hinge, one)
#define TRUEPOSE_ENUMERATOR(enumerator, name, unit) enumerator,
#define TRUEPOSE_ROW(enumerator, name, unit) ParameterProperties{name, Unit::unit},

/// Parameters of a chain, in this order. A telescopic chain has no arm and no rod; rod_difference
/// and rod_spacing change readings at the full level only; encoder_buildup is last, so that arms
/// can omit it.
enum class ChainParameter : int { TRUEPOSE_CHAIN_PARAMETERS(TRUEPOSE_ENUMERATOR) };
/// Parameters of a sensor, in this order; those that its kind lacks have zero columns.
enum class SensorParameter : int { TRUEPOSE_SENSOR_PARAMETERS(TRUEPOSE_ENUMERATOR) };
/// Parameters of a passive axis (which has no zero), or of a described mechanism's slide or hinge.
enum class AxisParameter : int { TRUEPOSE_AXIS_PARAMETERS(TRUEPOSE_ENUMERATOR) };
/// Parameters of a described closure of a mechanism, which its equations share.
enum class ClosureParameter : int { TRUEPOSE_CLOSURE_PARAMETERS(TRUEPOSE_ENUMERATOR) };

inline constexpr std::array kChainTable{TRUEPOSE_CHAIN_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr std::array kSensorParameterTable{TRUEPOSE_SENSOR_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr std::array kAxisTable{TRUEPOSE_AXIS_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr std::array kClosureTable{TRUEPOSE_CLOSURE_PARAMETERS(TRUEPOSE_ROW)};
inline constexpr int kChainParameters = int(kChainTable.size());
inline constexpr int kSensorParameters = int(kSensorParameterTable.size());
inline constexpr int kAxisParameters = int(kAxisTable.size());
inline constexpr int kClosureParameters = int(kClosureTable.size());

/// Passive axes, or all bodies of a mechanism.
inline int joints_of(const Robot& robot) {
  return is_mechanism(robot.mobility) ? robot.mechanism.bodies : passive_axes(robot.mobility);
}

int axis_column(const Robot& robot, int axis);
int closure_column(const Robot& robot, int described);

/// ξ: chains, then c of the bars, the sensors in use, the passive axes or the mechanism's joints,
/// and its closures.
inline int parameter_count(const Robot& robot) {
  return closure_column(robot, is_mechanism(robot.mobility) ? robot.mechanism.described : 0);
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

/// The sensors' rates by the motors', J_r J.
using PredictionRows = Matrix<kMaxSensors, kMaxMotors>;

/// q_e, H_x and, unless null, H_ξ at a closed position of any layout but the free one . At fixed x
/// the motors and hidden freedoms u = (q, h) follow a parameter: with A = ∂f/∂u and X = ∂f/∂x of
/// all closures f(u; x, ξ) = 0,
///
///     A δu + X δx + f_ξ δξ = 0        δq_e = e_u δu + e_x δx + e_ξ δξ
///
/// so that H_x = e_x - e_u A⁻¹ X and, with S = e_u A⁻¹ of one row per reading, H_ξ = e_ξ - S f_ξ.
/// @param g  unless null H_xi becomes P H_ξ, r rows, P = [-g, I]
/// @return also singular, with the chain whose arm is stretched, or -1
Outcome linearise(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                  Extended& q_e, PoseRows& H_x, Real* H_xi, const PredictionRows* g = nullptr);
/// Computes H_ξ = ∂[q; r]/∂ξ at a closed pose, (n + r) rows of parameter_count(robot), in the
/// caller's memory. Directions and normals have unit length; else divide their columns by it.
/// @param g  as of linearise
void parameter_jacobian(const Robot& robot, const Closure& closure, Real* H,
                        const PredictionRows* g = nullptr);
}  // namespace truepose
