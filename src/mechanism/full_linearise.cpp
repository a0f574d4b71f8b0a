#include "mechanism/full_linearise.hpp"

namespace truepose::full_detail {
Variation of_rod(Variation change, const Chain& chain, const Mat3& body, Real side) {
  const Vec3 u = pair_direction(chain);
  change.B += 0.5 * side * (chain.rod_spacing * change.turn.cross(u) + change.spacing * u);
  change.A += 0.5 * side * change.spacing * (body * chain.pair_drawn);
  change.rod += 0.5 * side * change.difference;
  return change;
}

void parameter_jacobian(const Robot& robot, const FullClosure& at,
                        const Matrix<kMaxReadings, kMaxUnknowns>& S, Real* H) {
  const int n = dof(robot.mobility);
  const int width = parameter_count(robot), readings = n + robot.r;
  std::fill(H, H + readings * width, 0.0);
  std::array<Sensed, kMaxSensors> sensed;
  for (int k = 0; k < robot.r; ++k) sensed[k] = sense_full(robot, robot.sensor[k], at);

  for (int i = 0; i < n; ++i) {
    const Chain& chain = robot.chain[i];
    const Driven& driven = at.driven[i];
    const Mat3 body = body_of(chain, at.pose);
    const auto enter = [&](int column, const Variation& change) {
      for (const int side : {1, -1}) {
        const int rod = 2 * i + (side < 0);
        const Variation own = of_rod(change, chain, body, side);
        const Real f = closure_change(at.v[rod], at.jq[rod], rod_length(chain, driven, side), own);
        for (int e = 0; e < readings; ++e) H[e * width + column] += S[e][rod] * f;
        for (int k = 0; k < robot.r; ++k) {
          const Sensor& sensor = robot.sensor[k];
          if (sensor.chain == i && rod_of(sensor) == rod)
            H[(n + k) * width + column] +=
                sensor.gain * sensor_change(sensor, sensed[k], chain, driven.dB, driven.rate, own);
        }
      }
    };
    for_each_variation(robot, i, at.q[i], driven.p, body, at.pose.R * chain.pivot, enter);
  }
  sensor_columns(robot, sensed, H);
}

}  // namespace truepose::full_detail

namespace truepose {
Status motors_pose(Level level, const Robot& robot, const Joint& q, Pose& pose, Parasitic& rest) {
  if (level == Level::ideal || !robot.full.own()) return fkm(robot, q, pose, kFkmStart).status;
  FullPose full = rest.beside(pose);
  FullClosure closure;
  const Status status = fkm_full(robot, q, full, closure, kFkmStart).status;
  if (status == Status::ok) {  // D and θ are the coordinates; tilt and bars follow from them
    pose = full;
    pose.R = turns_about_z(robot.mobility) ? rotation_z(pose.theta) : Mat3::Identity();
    Closure ideal;
    if (ikm(robot, pose, ideal)) rest = beyond_ideal(robot, closure, pose, ideal.q());
  }
  return status;
}
}  // namespace truepose
