// The redundant kinematic model (RKM) at the full level.
#pragma once

#include "mechanism/angles_of.hpp"
#include "mechanism/full_kinematics.hpp"
#include "mechanism/rkm.hpp"

namespace truepose {
/// Derivative of a reading at the full level.
struct FullRow {
  std::array<Real, kMaxUnknowns> z{};  ///< along the motion of full_row
  Real motor = 0;                      ///< along the motor of its chain, z held
};

/// Orientation of the body that carries a chain's A: R, or R R_z(ψ) of its bar.
inline Mat3 body_of(const Chain& chain, const FullPose& pose) {
  return chain.bar < 0 ? pose.R : Mat3(pose.R * rotation_z(pose.psi[chain.bar]));
}

/// Index of a sensor's rod (FullClosure).
inline int rod_of(const Sensor& sensor) { return 2 * sensor.chain + (sensor.rod < 0); }

/// Value and gradients of any sensor at a full pose. An angle sensor at bar k's hinge reads -ψ_k.
Sensed sense_full(const Robot& robot, const Sensor& sensor, const FullClosure& at);

/// Derivative of s, without the gain.
FullRow sensor_row(const Robot& robot, const Sensor& sensor, const FullClosure& at,
                   const Sensed& s);

/// Readings of a mechanism in any position, its loops closed or not. With backlash or compliant
/// arms the motors' encoders see one angle and the rods' joints another.
/// @param motor, arm  angles or slides before the encoders' offsets
Outcome read_standing(const Robot& robot, const FullPose& pose, const Joint& motor,
                      const Joint& arm, Extended& q_e);

/// r = RKM at the full level, and its derivatives.
/// @return not_measured: an angle at the hinge of a missing bar; not_finite: a sensor cannot read
Outcome rkm_full(const Robot& robot, const FullClosure& at, Reading& values,
                 std::array<FullRow, kMaxSensors>& rows);

/// q_e at a pose with all rods closed, and the inputs of its derivatives.
/// @param rows  of the sensors @param rest  as of ikm_full
Outcome extended_full(const Robot& robot, const Pose& pose, Extended& q_e, FullClosure& closure,
                      std::array<FullRow, kMaxSensors>& rows, Parasitic* rest);

/// r = RKM(x) at the full level, the tilt and the bars' turns included.
Outcome rkm_full(const Robot& robot, const Coordinates& x, Reading& values);
}  // namespace truepose
