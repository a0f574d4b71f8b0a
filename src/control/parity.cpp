// Parity: the disagreement of the redundant readings with the motors.
#include "control/parity.hpp"

namespace truepose {
Reading Parity::signature(int r, int reading) const {
  Reading column{};
  for (int k : range(r)) column[k] = reading < n ? -g[k][reading] : reading - n == k;
  return column;
}

Outcome Parity::look(const Robot& robot, const Pose& from, const Extended& beyond) {
  n = robot.motors;
  Closure closure;
  Reading values;
  SensorRows jr;
  const Outcome outcome = kinematics_at(robot, from, 0, closure, jacobians, values, jr);
  if (!outcome) return outcome;
  extend(robot, closure.q(), values, expected);
  for (int c : range(n + robot.r)) expected[c] += beyond[c];
  for (int k : range(robot.r))
    for (int j : range(n)) {
      g[k][j] = 0;
      for (int i : range(jacobians.n)) g[k][j] += jr[k][i] * jacobians.J[i][j];
    }
  return {};
}

Outcome Parity::locate(const Robot& robot, const MotorsPose& last, const Extended& q_e,
                       const Extended& beyond) {
  n = robot.motors;
  constexpr Real kNear = 1e-3;  // motor error; one step leaves its square
  if (last.placed) {
    pose = moved(robot.mobility, last.pose, last.motion);
  } else {
    pose = to_pose(robot.mobility, robot.home);
    const Status found = fkm(robot, motors_of(robot, q_e), pose).status;
    if (!Outcome{found}) return {found};
  }
  read = q_e;
  Extended error;
  for (int left = 3; left > 0; --left) {
    const Outcome outcome = look(robot, pose, beyond);
    if (!outcome) return outcome;
    Real farthest = 0;
    innovation(robot, q_e, expected, error);
    Coordinates step{};
    for (int j : range(n)) {
      farthest = max(farthest, fabs(error[j]));
      for (int i : range(jacobians.n)) step[i] += jacobians.J[i][j] * error[j];
    }
    pose = moved(robot.mobility, pose, step);
    if (farthest < kNear) break;
  }
  for (int k : range(robot.r)) {
    value[k] = error[n + k];
    for (int j : range(n)) value[k] -= g[k][j] * error[j];
  }
  const bool finite =
      all_finite(to_coordinates(robot.mobility, pose), jacobians.n) && all_finite(value, robot.r);
  return {finite ? Status::ok : Status::not_finite};
}

void Parity::covariance(int r, const Extended& noise, const ParityGeometry& geometry, Real share,
                        ReadingCovariance& V) const {
  for (int k : range(r))
    for (int l : range(k + 1)) {
      Real sum = share * geometry[k][l] + (k == l ? noise[n + k] : 0);
      for (int j : range(n)) sum += g[l][j] * noise[j] * g[k][j];
      V.L[k][l] = sum;
    }
}

Real chi_squared(const ReadingCovariance& V, int r, Reading parity) {
  V.whiten(r, parity.data(), 1);
  return sum_of(r, [&](int k) { return parity[k] * parity[k]; });
}

Outcome Parity::geometry_at(const Robot& robot, const Pose& pose, const Knowledge& known,
                            Real* work, ParityGeometry& geometry, Extended& beyond,
                            Parasitic& rest) const {
  const int r = robot.r, width = parameter_count(robot), count = known.count;
  Real *PH = work, *B = PH + readings(robot) * width;
  beyond.fill(0);
  Extended q_e;
  PoseRows H_x;
  rest.left = cycle_steps(robot);
  const auto of = [&](const auto& at) -> Outcome {
    if constexpr (requires { at.built; })
      return linearise(robot, at.built, at.at, at.pose.theta, q_e, H_x, PH, &g);
    else
      parameter_jacobian(robot, at, PH, &g);
    return {};
  };
  Outcome outcome = closed(level_of(robot), robot, pose, of, &rest);
  if (outcome && robot.rod_by_rod()) {
    Extended ideal;
    outcome = extended(Level::ideal, robot, pose, ideal);
    if (!outcome) return outcome;
    for (int c : range(readings(robot))) beyond[c] = q_e[c] - ideal[c];
  }
  if (!outcome) return outcome;
  for (int k : range(r))
    for (int m : range(count)) B[k * count + m] = PH[k * width + known.column[m]];
  times_root(known, r, B);
  for (int k : range(r))
    for (int l : range(k + 1)) geometry[k][l] = dot(count, B + k * count, B + l * count);
  return outcome;
}
}  // namespace truepose
