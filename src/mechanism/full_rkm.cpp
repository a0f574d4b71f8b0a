#include "mechanism/full_rkm.hpp"

namespace truepose {
Sensed sense_full(const Robot& robot, const Sensor& sensor, const FullClosure& at) {
  if (on_chain(sensor)) {
    const Chain& chain = robot.chain[sensor.chain];
    return sense_chain(sensor,
                       {chain, motor_position(chain, at.q[sensor.chain]), at.driven[sensor.chain].p,
                        at.v[rod_of(sensor)], body_of(chain, at.pose)});
  }
  if (!properties(sensor.kind).is_theta) return sense_pose(sensor, at.pose);
  Sensed s;
  if (sensor.bar >= 0) {
    s.value = -at.pose.psi[sensor.bar];
  } else {
    s.value = at.pose.theta;
    s.angular = theta_row(at.pose.R);
  }
  read_off_centre(sensor, s);
  return s;
}

FullRow sensor_row(const Robot& robot, const Sensor& sensor, const FullClosure& at,
                   const Sensed& s) {
  FullRow row;
  if (!on_chain(sensor)) {
    twist_row(s.linear, s.angular, row.z.data());
    if (properties(sensor.kind).is_theta && sensor.bar >= 0) row.z[6 + sensor.bar] = -s.slope;
    return row;
  }
  const Chain& chain = robot.chain[sensor.chain];
  const int rod = rod_of(sensor);
  // A moves with the platform and its bar; so does the frame of a joint on them.
  const Vec3 turn = sensor.at_nacelle ? s.frame : Vec3::Zero();
  twist_row(s.rod, at.lever[rod].cross(s.rod) + turn, row.z.data());
  if (chain.bar >= 0) row.z[6 + chain.bar] = at.pose.R.col(2).dot(at.arm[rod].cross(s.rod) + turn);
  row.motor = by_motor(sensor, s, chain, at.driven[sensor.chain].dB, at.driven[sensor.chain].rate);
  return row;
}

Outcome read_standing(const Robot& robot, const FullPose& pose, const Joint& motor,
                      const Joint& arm, Extended& q_e) {
  if (!robot.finished) return {Status::unfinished, -1};
  FullClosure at;
  at.pose = pose;
  at.pose.theta = theta_of(pose.R, pose.theta);
  for (int i = 0; i < dof(robot.mobility); ++i) {
    q_e[i] = motor_reading(robot.chain[i], motor[i]);
    at.q[i] = motor_reading(robot.chain[i], arm[i]);
    at.driven[i] = driven_point(robot.chain[i], at.q[i]);
  }
  complete_closure(robot, at);
  Pose angles = to_pose(robot.mobility, robot.home);
  if (is_rotational(robot.mobility)) angles_of(robot, {pose.D, pose.R, 0}, angles);
  for (int k = 0; k < robot.r; ++k) {
    const Sensor& sensor = robot.sensor[k];
    const bool of_axis = is_rotational(robot.mobility) && sensor.kind == SensorKind::axis_angle;
    const Sensed s = of_axis ? sense_axis(sensor, angles) : sense_full(robot, sensor, at);
    q_e[dof(robot.mobility) + k] = sensor.gain * s.value - sensor.offset;
  }
  return {all_finite(q_e, dof(robot.mobility) + robot.r) ? Status::ok : Status::not_finite, -1};
}

Outcome rkm_full(const Robot& robot, const FullClosure& at, Reading& values,
                 std::array<FullRow, kMaxSensors>& rows) {
  for (int k = 0; k < robot.r; ++k) {
    const Sensor& sensor = robot.sensor[k];
    if (sensor.bar >= robot.full.bars) return {Status::not_measured, -1};
    const Sensed s = sense_full(robot, sensor, at);
    values[k] = sensor.gain * s.value - sensor.offset;
    rows[k] = sensor_row(robot, sensor, at, s);
    for (Real& entry : rows[k].z) entry *= sensor.gain;
    rows[k].motor *= sensor.gain;
  }
  return {all_finite(values, robot.r) ? Status::ok : Status::not_finite, -1};
}

Outcome extended_full(const Robot& robot, const Pose& pose, Extended& q_e, FullClosure& closure,
                      std::array<FullRow, kMaxSensors>& rows, Parasitic* rest) {
  Outcome outcome = ikm_full(robot, pose, closure, rest);
  Reading values;
  if (outcome) outcome = rkm_full(robot, closure, values, rows);
  if (outcome) extend(robot, closure.q, values, q_e);
  return outcome;
}

Outcome rkm_full(const Robot& robot, const Coordinates& x, Reading& values) {
  return full_detail::closed(
      robot, x,
      [&](const FullClosure& closure) {
        std::array<FullRow, kMaxSensors> rows;
        return rkm_full(robot, closure, values, rows);
      },
      [&] { return rkm(robot, x, values); });
}
}  // namespace truepose
