// Readings of sensors on a mechanism of the engine; derivatives as twists times lines.
#pragma once

#include "mechanism/build.hpp"
#include "mechanism/sensor.hpp"

namespace truepose {
/// A sensor's value and gradients, all without the gain.
struct SensedFreedoms : Sensed {
  engine::Row row{};  ///< by all freedoms
  /// By a motion of a body: of the platform's side, and of the base's side of a rod.
  struct Side {
    int body = -1;  ///< -1: none
    engine::Line line{Vec3::Zero(), Vec3::Zero()};
  };
  std::array<Side, 2> side;
};

/// Reads a sensor at any layout. An angle sensor at bar k's hinge reads -ψ_k.
/// @param theta  of the platform
SensedFreedoms sense(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                     const Sensor& sensor);

/// q_e at any layout. @return not_measured: an angle at the hinge of a missing bar; not_finite
Outcome read(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
             Extended& q_e);
}  // namespace truepose
