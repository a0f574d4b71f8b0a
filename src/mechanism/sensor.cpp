// Reading of a redundant sensor and its derivative by the pose: s(x), J_r.
#include "mechanism/sensor.hpp"

namespace truepose {
void read_off_centre(const Sensor& sensor, Sensed& s) {
  s.angle = s.value;
  if (!eccentric(sensor)) return;
  const Encoded read = encode(sensor.eccentricity, s.angle);
  s.value = read.value;
  s.slope = read.slope;
  for (Vec3* gradient : {&s.linear, &s.angular, &s.rod, &s.frame, &s.direction, &s.normal})
    *gradient *= read.slope;
  s.motor *= read.slope;
}

Sensed sense_axis(const Sensor& sensor, const Pose& angles) {
  Sensed s;
  s.value = angles.D[sensor.axis];
  read_off_centre(sensor, s);
  return s;
}

Sensed sense(const Robot& robot, const Sensor& sensor, const Closure& closure) {
  if (sensor.kind == SensorKind::axis_angle) return sense_axis(sensor, closure.pose);
  if (!on_chain(sensor)) return sense_pose(sensor, closure.placed());
  const Chain& chain = robot.chain[sensor.chain];
  const ChainState& state = closure.chain[sensor.chain];
  return sense_chain(sensor, {chain, motor_position(chain, state.q), state.p, state.v,
                              body_of(chain, closure.placed())});
}

void sensor_row(const Robot& robot, const Sensor& sensor, const Closure& closure, const Sensed& s,
                Real* row) {
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
  const Vec3 pull = s.rod + by_motor(sensor, s, chain, state.dB, state.rate) / state.jq * state.v;
  free_row(closure.carried, pull, state.lever.cross(pull) + turn, row);
}

Real any_reading(const Robot& robot, const Sensor& sensor, const Closure& closure, Real* row) {
  const Sensed s = sense(robot, sensor, closure);
  sensor_row(robot, sensor, closure, s, row);
  for (int j = 0; j < dof(robot.mobility); ++j) row[j] *= sensor.gain;
  return sensor.gain * s.value - sensor.offset;
}

Real sensor_reading(const Robot& robot, const Sensor& sensor, const Closure& closure, Real* row) {
  if (sensor.kind != SensorKind::platform_angle || eccentric(sensor))
    return any_reading(robot, sensor, closure, row);
  free_row(closure.carried, Vec3::Zero(), Vec3(0, 0, sensor.gain), row);
  return sensor.gain * closure.pose.theta - sensor.offset;
}
}  // namespace truepose
