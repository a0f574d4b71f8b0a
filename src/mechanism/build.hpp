// Robots as mechanisms of the engine: y = [motors; x; hidden freedoms].
#pragma once

#include "mechanism/mechanism.hpp"

namespace truepose {
/// How a robot is described.
enum class Layout : int {
  ideal = 0,  ///< one rod per chain; bars keep their orientation
  full = 1,   ///< every rod by itself: the platform may tilt, its bars may turn
  free = 2,   ///< every rod and bar by itself, the platform anywhere: x is [D; rotation vector]
};

/// A robot's mechanism, and where its parts are.
struct Built {
  engine::Mechanism mechanism;
  Layout layout;
  int rods_per_chain;               ///< closure i · rods_per_chain is the first rod of chain i
  int platform;                     ///< body
  int yaw;                          ///< freedom θ of the platform; -1: none
  int turn;                         ///< freedom of the first bar's turn ψ; -1: none
  std::array<int, kMaxChains> arm;  ///< body that carries B; -1: the base
  std::array<int, kMaxChains> bar;  ///< body that carries A

  int rod_of(const Sensor& sensor) const {
    return rods_per_chain * sensor.chain + (rods_per_chain == 2 && sensor.rod < 0);
  }
  /// Freedom ψ_k of a bar. A four-bar's bars turn together.
  int turn_of(const Robot& robot, int k) const {
    const bool together = robot.bar_joint == BarJoint::four_bar && layout == Layout::full;
    return turn + (together ? 0 : k);
  }
};

/// Describes a robot. The geometry is the robot's at present.
void build(const Robot& robot, Layout layout, Built& built);

/// From rod - to rod + at the base-side joint, unit: along a motor's axis, across a carriage's rail
/// (rods one above the other on upright rails would leave the platform free to turn about z).
inline Vec3 pair_direction(const Chain& chain) {
  return chain.actuator == Actuator::prismatic ? chain.pair_axis : chain.axis;
}

/// y with the motors at q and the platform at a pose of the ideal level: untilted, the bars in
/// their orientation.
engine::Row stand(const Robot& robot, const Built& built, const Joint& q, const Pose& pose);

/// A closure of the ideal level as a position of its mechanism.
void stand(const Robot& robot, const Closure& closure, Built& built, engine::Position& at);
}  // namespace truepose
