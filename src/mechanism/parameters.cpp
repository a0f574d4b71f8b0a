#include "mechanism/parameters.hpp"

namespace truepose {
int axis_column(const Robot& robot, int axis) {
  assert(axis >= 0 && axis < passive_axes(robot.mobility));
  return robot.chains * kChainParameters + kMaxBars + robot.r * kSensorParameters +
         axis * kAxisParameters;
}

std::array<Real, 6> encoder_reading(const Chain& chain, Real q, const Vec3& p) {
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

Variation vary(const Chain& chain, const Vec3& p, const Mat3& body,
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
    case ChainParameter::tilt: change.turn = chain.zero; break;    // turns u about e
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

void sensor_columns(const Robot& robot, int sensor, const Sensed& s, Real* H) {
  const Sensor& of = robot.sensor[sensor];
  Real* row =
      H + (dof(robot.mobility) + sensor) * parameter_count(robot) + sensor_column(robot, sensor);
  row[static_cast<int>(SensorParameter::offset)] = -1;
  row[static_cast<int>(SensorParameter::gain)] = s.value;
  int column = static_cast<int>(SensorParameter::origin_x);
  const Vec3 direction = turned_only(s.direction, of.direction);
  const Vec3 normal = turned_only(s.normal, of.normal);
  for (const Vec3* vector : {&s.origin, &direction, &s.target, &normal})
    for (int axis = 0; axis < 3; ++axis) row[column++] = of.gain * (*vector)[axis];
  if (!rotary(of)) return;
  for (const Real harmonic : harmonics(of.eccentricity, s.angle))
    row[column++] = of.gain * harmonic / of.eccentricity.gear;
}
}  // namespace truepose
