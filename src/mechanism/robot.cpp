// Robots as plain data: chains, sensors, bodies. One struct serves every mechanism.
#include "mechanism/robot.hpp"

#include "mechanism/mechanism.hpp"

namespace truepose {
Outcome parts_exist(const Robot& robot) {
  const auto missing = [](int part) { return Outcome{Status::no_such_part, part}; };
  const auto below = [](auto index, int count) { return int(index) >= 0 && int(index) < count; };
  const bool described = is_mechanism(robot.mobility);
  const engine::Mechanism& m = robot.mechanism;
  const auto bar = [&](int index) {
    return index == -1 || below(index, described ? m.bodies : kMaxBars);
  };
  const auto sign = [](int value) { return value == 1 || value == -1; };
  if (!below(robot.mobility, kMobilities) || !below(robot.chains, kMaxChains + 1) ||
      !below(robot.motors, robot.chains + 1) || !below(robot.r, kMaxSensors + 1) ||
      robot.motors + robot.r > kMaxReadings || !below(robot.bodies, kMaxBodies + 1) ||
      !below(robot.bar_joint, 2) || !below(robot.level, 2))
    return missing(-1);
  for (int i : range(robot.chains)) {
    const Chain& chain = robot.chain[i];
    if (!below(chain.actuator, 3) || !sign(chain.working_mode) || !bar(chain.bar))
      return missing(i);
  }
  for (int k : range(robot.r)) {
    const Sensor& sensor = robot.sensor[k];
    if (!below(sensor.kind, kSensorKinds)) return missing(kSensorPart + k);
    const bool rod = described && sensor.kind != SensorKind::motor_encoder;
    const bool chain = properties(sensor.kind).of_chain
                           ? below(sensor.chain, rod ? m.closures : robot.chains)
                           : sensor.chain == -1;
    const bool joint =
        sensor.kind == SensorKind::joint_angle || sensor.kind == SensorKind::slide_position;
    const bool axis = joint ? described && below(sensor.axis, m.freedoms)
                            : sensor.kind != SensorKind::axis_angle ||
                                  below(sensor.axis, passive_axes(robot.mobility));
    if (!chain || !axis || !sign(sensor.rod) || !bar(sensor.bar)) return missing(kSensorPart + k);
  }
  for (int k : range(robot.bodies))
    if (!bar(robot.body[k].bar)) return missing(kBodyPart + k);
  if (!described) return {};
  const bool whole = engine::check_parts(m) && m.motors == robot.motors &&
                     m.coordinates == dof(robot.mobility) && below(m.platform, m.bodies);
  for (int i = 0; i < m.closures && whole; ++i)
    if (!below(m.closure[i].described, m.described)) return missing(-1);
  return whole ? Outcome{} : missing(-1);
}

void note_encoders(Robot& robot) {
  for (int i : range(robot.chains))
    robot.chain[i].encoder_errs = robot.chain[i].encoder_gain != 1 ||
                                  robot.chain[i].encoder_buildup != 0 ||
                                  robot.chain[i].eccentricity.any();
}

void note_vertical(Robot& robot) {
  const Vec3& g = robot.gravity;
  for (int k : range(robot.r))
    if (robot.sensor[k].kind == SensorKind::inclinometer)
      robot.sensor[k].origin = g.norm() > 0 ? -g.normalized() : Vec3::UnitZ();
}
}  // namespace truepose
