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

Real sensor_change(const Sensor& sensor, const Sensed& s, const Chain& chain, const Vec3& dB,
                   Real rate, const Variation& change) {
  const Real turned = sensor.at_nacelle ? 0 : s.frame.dot(change.turn);
  return s.rod.dot(change.A - change.B) + turned +
         by_motor(sensor, s, chain, dB, rate) * change.motor;
}

void sensor_columns(const Robot& robot, const std::array<Sensed, kMaxSensors>& sensed, Real* H) {
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

void parameter_jacobian(const Robot& robot, const Pose& pose, const ChainState* states,
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

void axis_columns([[maybe_unused]] const Robot& robot, [[maybe_unused]] const Closure& closure,
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

void parameter_jacobian(const Robot& robot, const Closure& closure, Real* H) {
  std::array<Sensed, kMaxSensors> sensed;
  for (int k = 0; k < robot.r; ++k) sensed[k] = sense(robot, robot.sensor[k], closure);
  parameter_jacobian(robot, closure.placed(), closure.chain.data(), sensed, H);
  axis_columns(robot, closure, sensed, H);
}
}  // namespace truepose
