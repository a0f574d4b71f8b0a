// Readings of sensors on a mechanism of the engine; derivatives as twists times lines.
#include "mechanism/sense_mechanism.hpp"

namespace truepose {
SensedFreedoms sense(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                     const Sensor& sensor) {
  const engine::Mechanism& m = built.mechanism;
  const engine::Frame& platform = at.frame[built.platform];
  SensedFreedoms s;
  Sensed& sensed = s;
  if (on_chain(sensor)) {
    const int rod = built.rod_of(sensor), arm = built.arm[sensor.chain];
    const Chain& chain = robot.chain[sensor.chain];
    const Mat3& body = chain.bar < 0 ? platform.R : at.frame[built.bar[sensor.chain]].R;
    const bool revolute = chain.actuator == Actuator::revolute;
    const Vec3 p = revolute ? at.frame[arm].R * (chain.arm * chain.zero) : Vec3::Zero();
    sensed = sense_chain(sensor, {chain, at.y[sensor.chain], p, at.B[rod] - at.A[rod], body});
    // The frame of its joint turns with the platform's side or with the arm.
    s.platform = engine::line_through(at.A[rod], s.rod);
    engine::Line of_B = engine::line_through(at.B[rod], s.rod);
    if (sensor.at_nacelle)
      s.platform.moment += s.frame;
    else if (revolute)
      of_B.moment -= s.frame;
    engine::add_line(m, at, built.bar[sensor.chain], s.platform, 1, s.row);
    engine::add_line(m, at, arm, of_B, -1, s.row);
    s.row[sensor.chain] += s.motor;
    return s;
  }
  const auto read = [&](int freedom, Real sign) {
    s.value = sign * at.y[freedom];
    read_off_centre(sensor, s);
    s.row[freedom] = sign * s.slope;
    return s;
  };
  if (sensor.kind == SensorKind::axis_angle) return read(m.motors + sensor.axis, 1);
  if (properties(sensor.kind).is_theta) {
    if (sensor.bar >= 0 && built.layout != Layout::ideal)
      return read(built.turn_of(robot, sensor.bar), -1);
    if (built.yaw >= 0) return read(built.yaw, 1);
  }
  sensed = sense_pose(sensor, {platform.p, platform.R, theta});
  s.platform = engine::line_through(platform.p, s.linear);
  s.platform.moment += s.angular;
  engine::add_line(m, at, built.platform, s.platform, 1, s.row);
  return s;
}

Outcome read(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
             Extended& q_e) {
  for (int i = 0; i < robot.motors; ++i) q_e[i] = motor_reading(robot.chain[i], at.y[i]);
  for (int k = 0; k < robot.r; ++k) {
    const Sensor& sensor = robot.sensor[k];
    if (built.layout == Layout::full && sensor.bar >= robot.full.bars)
      return {Status::not_measured, -1};
    q_e[robot.motors + k] =
        sensor.gain * sense(robot, built, at, theta, sensor).value - sensor.offset;
  }
  return {all_finite(q_e, readings(robot)) ? Status::ok : Status::not_finite, -1};
}
}  // namespace truepose
