// The redundant kinematic model (RKM): readings of all redundant sensors at a pose.
#include "mechanism/rkm.hpp"

#include "mechanism/sense_mechanism.hpp"

namespace truepose {
namespace {
/// All readings by the engine, the motors following the pose by K = J_q⁻¹ J_x. Kept apart from the
/// paper's θ, whose stack is small.
[[gnu::noinline]] void sense_all(const Robot& robot, const Closure& closure, Reading& values,
                                 SensorRows& jr) {
  const int m = robot.motors;
  Built built;
  engine::Position at;
  stand(robot, closure, built, at);
  Square K;
  inverse_rows(closure, K);
  for (int k : range(robot.r)) {
    const Sensor& sensor = robot.sensor[k];
    const SensedFreedoms s = sense(robot, built, at, closure.pose.theta, sensor);
    values[k] = sensor.gain * s.value - sensor.offset;
    for (int j : range(closure.carried.n)) {
      Real slope = s.row[m + j];
      for (int i : range(m))
        if (s.row[i] != 0) slope += s.row[i] * closure.chain[i].rate * K[i][j];
      jr[k][j] = sensor.gain * slope;
    }
  }
}
}  // namespace

Outcome rkm(const Robot& robot, const Closure& closure, Reading& values, SensorRows& jr) {
  bool plain = true;  // all read the paper's θ
  for (int k : range(robot.r)) {
    const Sensor& sensor = robot.sensor[k];
    plain = plain && sensor.kind == SensorKind::platform_angle && !eccentric(sensor);
    values[k] = sensor.gain * closure.pose.theta - sensor.offset;
    free_row(closure.carried, Vec3::Zero(), Vec3(0, 0, sensor.gain), jr[k].data());
  }
  if (!plain) sense_all(robot, closure, values, jr);
  Real sum = 0;  // a NaN shows in it
  for (int k : range(robot.r)) {
    sum += values[k];
    for (int j : range(closure.carried.n)) sum += jr[k][j];
  }
  return {isfinite(sum) ? Status::ok : Status::not_finite};
}

Joint motors_of(const Robot& robot, const Extended& q_e) {
  Joint q{};
  copy_first(robot.motors, q_e, q);
  return q;
}
}  // namespace truepose
