// Readings of sensors on a mechanism of the engine; derivatives as twists times lines.
#include "mechanism/sense_mechanism.hpp"

namespace truepose {
namespace {
/// Reads a sensor at a rod. Its joint is built along axes of the body on its side: the sensor's
/// own, or at the base's side of a chain those of the arm or carriage.
void sense_rod(const Robot& robot, const Built& built, const engine::Position& at,
               const Sensor& sensor, SensedFreedoms& s) {
  const bool described = is_mechanism(robot.mobility), mounted = described || sensor.at_nacelle;
  const Chain& chain = robot.chain[described ? 0 : sensor.chain];
  const int rod = built.rod_of(sensor);
  const engine::Closure& of = built.mechanism.closure[rod];
  const int body = !sensor.at_nacelle            ? of.body_b
                   : described || chain.bar >= 0 ? of.body_a
                                                 : built.platform;
  static_cast<Sensed&>(s) = sense_chain(
      sensor, {at.A[rod] - at.B[rod], at.direction(body, mounted ? sensor.normal : chain.zero),
               at.direction(body, mounted ? sensor.direction : chain.axis),
               body < 0 ? Mat3::Identity() : at.frame[body].R, mounted});
  s.side[0] = {of.body_a, engine::line_through(at.A[rod], s.rod)};
  s.side[1] = {of.body_b, engine::line_through(at.B[rod], -s.rod)};
  // The frame of the joint turns with its own side.
  s.side[sensor.at_nacelle ? 0 : 1].line.moment += s.frame;
}
}  // namespace

SensedFreedoms sense(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                     const Sensor& sensor) {
  const engine::Mechanism& m = built.mechanism;
  const bool described = is_mechanism(robot.mobility);
  SensedFreedoms s;
  const auto read = [&](int freedom, Real sign) {
    s.value = sign * at.y[freedom];
    if (rotary(sensor)) read_off_centre(sensor, s);
    s.row[freedom] = sign * s.slope;
    return s;
  };
  if (sensor.kind == SensorKind::motor_encoder) return read(sensor.chain, 1);
  if (sensor.kind == SensorKind::joint_angle || sensor.kind == SensorKind::slide_position)
    return read(sensor.axis, 1);
  if (sensor.kind == SensorKind::axis_angle) return read(m.motors + sensor.axis, 1);
  if (properties(sensor.kind).is_theta) {
    if (sensor.bar >= 0 && built.layout != Layout::ideal)
      return read(built.turn_of(robot, sensor.bar), -1);
    if (built.yaw >= 0) return read(built.yaw, 1);
  }
  if (on_chain(sensor)) {
    sense_rod(robot, built, at, sensor, s);
  } else {
    const int body = described && sensor.bar >= 0 ? sensor.bar : built.platform;
    const engine::Frame& on = at.frame[body];
    static_cast<Sensed&>(s) = sense_pose(sensor, {on.p, on.R, theta});
    s.side[0] = {body, engine::line_through(on.p, s.linear)};
    s.side[0].line.moment += s.angular;
  }
  for (const auto& side : s.side) engine::add_line(m, at, side.body, side.line, 1, s.row);
  return s;
}

Outcome read(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
             Extended& q_e) {
  for (int i : range(robot.motors)) q_e[i] = motor_reading(robot.chain[i], at.y[i]);
  for (int k : range(robot.r)) {
    const Sensor& sensor = robot.sensor[k];
    if (built.layout == Layout::full && !is_mechanism(robot.mobility) &&
        sensor.bar >= robot.full.bars)
      return {Status::not_measured};
    q_e[robot.motors + k] =
        sensor.gain * sense(robot, built, at, theta, sensor).value - sensor.offset;
  }
  return {all_finite(q_e, readings(robot)) ? Status::ok : Status::not_finite};
}
}  // namespace truepose
