// How does every reading change with every geometric parameter ξ? The order of ξ, and H_ξ.
//
// Two layers: a parameter varies points, directions and lengths of a chain (Variation), once; the
// readings know their derivatives with respect to those (Sensed, the closure). Everything is at
// fixed pose x, the motors following: ∂q/∂ξ, ∂r/∂ξ.
#pragma once

#include "truepose/rkm.hpp"

namespace truepose {

/// Parameters of a chain, in this order. A telescopic chain has no arm and no rod.
enum class ChainParameter : int {
  base_x,
  base_y,
  base_z,
  arm,
  rod,
  encoder_offset,
  yaw,
  tilt,
  anchor_x,
  anchor_y,
  anchor_z,
  rod_difference,  ///< these two: full level only
  rod_spacing
};
inline constexpr int kChainParameters = 13;

/// Parameters of a sensor, in this order; those that its kind does not have have zero columns.
enum class SensorParameter : int {
  offset,
  gain,
  origin_x,
  origin_y,
  origin_z,
  direction_x,
  direction_y,
  direction_z,
  target_x,
  target_y,
  target_z,
  normal_x,
  normal_y,
  normal_z
};
inline constexpr int kSensorParameters = 14;

/// ξ: chains, then the pivots of the bars, then the sensors in use.
inline int parameter_count(const Robot& robot) {
  return dof(robot.mobility) * kChainParameters + kMaxBars + robot.r * kSensorParameters;
}
inline int chain_column(int chain) { return chain * kChainParameters; }
inline int bar_column(const Robot& robot, int bar) {
  return dof(robot.mobility) * kChainParameters + bar;
}
inline int sensor_column(const Robot& robot, int sensor) {
  return bar_column(robot, kMaxBars) + sensor * kSensorParameters;
}

/// What a parameter moves, at fixed pose and fixed encoder reading.
struct Variation {
  Vec3 B = Vec3::Zero(), A = Vec3::Zero();
  Vec3 turn = Vec3::Zero();  ///< of the frame e, u×e, u at the motor
  double rod = 0;            ///< of L
  double motor = 0;          ///< of the motor's angle or position
};

inline Variation vary(const Chain& chain, const ChainState& state, const Pose& pose,
                      ChainParameter parameter) {
  Variation change;
  const auto unit = [&](ChainParameter first) -> Vec3 {
    return Vec3::Unit(static_cast<int>(parameter) - static_cast<int>(first));
  };
  switch (parameter) {
    case ChainParameter::base_x:
    case ChainParameter::base_y:
    case ChainParameter::base_z: change.B = unit(ChainParameter::base_x); break;
    case ChainParameter::arm:
      if (chain.actuator == Actuator::revolute) change.B = state.p / chain.arm;
      break;
    case ChainParameter::rod: change.rod = chain.actuator == Actuator::telescopic ? 0 : 1; break;
    case ChainParameter::encoder_offset: change.motor = 1; break;
    case ChainParameter::yaw: change.turn = Vec3::UnitZ(); break;  // adds to α
    case ChainParameter::tilt: change.turn = chain.zero; break;    // turns u about e
    case ChainParameter::anchor_x:
    case ChainParameter::anchor_y:
    case ChainParameter::anchor_z: {
      const Vec3 e = unit(ChainParameter::anchor_x);
      change.A = chain.bar < 0 ? Vec3(pose.R * e) : e;
      break;
    }
    case ChainParameter::rod_difference:
    case ChainParameter::rod_spacing: break;
  }
  if (!change.turn.isZero(0)) change.B = change.turn.cross(state.p);
  return change;
}

/// ∂q of a chain: the closure v·(dB (δq + δmotor) + δB - δA) = L δL.
inline double motor_change(const ChainState& state, double rod, const Variation& change) {
  return (state.v.dot(change.A - change.B) + rod * change.rod) / state.jq - change.motor;
}

/// ∂s of a sensor on that chain, its own motor following.
inline double sensor_change(const Sensor& sensor, const Sensed& s, const Chain& chain,
                            const ChainState& state, const Variation& change) {
  const double motion = motor_change(state, chain.rod, change) + change.motor;
  const Vec3 turn = sensor.at_nacelle ? Vec3(Vec3::Zero()) : change.turn;
  return s.rod.dot(change.A - change.B) + s.frame.dot(turn) +
         by_motor(sensor, s, chain, state) * motion;
}

/// H_ξ = ∂[q; r]/∂ξ at a closed pose, (n + r) rows of parameter_count(robot), in memory the caller
/// owns. Directions and normals count as free vectors: projecting them on unit length is the
/// caller's, who knows how they were given.
template <Mobility K>
inline void parameter_jacobian(const Robot& robot, const Closure<K>& closure, double* H) {
  constexpr int n = kDof<K>;
  const int width = parameter_count(robot);
  std::fill(H, H + (n + robot.r) * width, 0.0);
  std::array<Sensed, kMaxSensors> sensed;
  for (int k = 0; k < robot.r; ++k) sensed[k] = sense<K>(robot, robot.sensor[k], closure);

  for (int i = 0; i < n; ++i) {
    const Chain& chain = robot.chain[i];
    const ChainState& state = closure.chain[i];
    const auto enter = [&](int column, const Variation& change) {
      H[i * width + column] += motor_change(state, chain.rod, change);
      for (int k = 0; k < robot.r; ++k)
        if (robot.sensor[k].chain == i)
          H[(n + k) * width + column] +=
              robot.sensor[k].gain *
              sensor_change(robot.sensor[k], sensed[k], chain, state, change);
    };
    for (int p = 0; p < kChainParameters; ++p)
      enter(chain_column(i) + p, vary(chain, state, closure.pose, static_cast<ChainParameter>(p)));
    if (chain.bar >= 0 && chain.bar < kMaxBars) {  // the pivot moves along itself
      Variation change;
      change.A = state.lever.normalized();
      enter(bar_column(robot, chain.bar), change);
    }
  }

  for (int k = 0; k < robot.r; ++k) {
    double* row = H + (n + k) * width + sensor_column(robot, k);
    const Sensed& s = sensed[k];
    row[static_cast<int>(SensorParameter::offset)] = -1;
    row[static_cast<int>(SensorParameter::gain)] = s.value;
    int column = static_cast<int>(SensorParameter::origin_x);
    for (const Vec3* vector : {&s.origin, &s.direction, &s.target, &s.normal})
      for (int axis = 0; axis < 3; ++axis) row[column++] = robot.sensor[k].gain * (*vector)[axis];
  }
}

}  // namespace truepose
