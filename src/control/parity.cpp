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
  Outcome outcome = jacobian_at(robot, from, closure, jacobians);
  if (outcome) outcome = rkm(robot, closure, values, jr);
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

Outcome Parity::locate(const Robot& robot, const Pose& near, const Extended& q_e,
                       const Extended& beyond) {
  n = robot.motors;
  constexpr Real kNear = 1e-3;  // motor error; one step leaves its square
  pose = near;
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

void Parity::covariance(int r, const Extended& noise,
                        const Matrix<kMaxSensors, kMaxSensors>& geometry, Real share,
                        ReadingCovariance& V) const {
  for (int k : range(r))
    for (int l : range(k + 1)) {
      Real sum = share * geometry[k][l] + (k == l ? noise[n + k] : 0);
      for (int j : range(n)) sum += g[l][j] * noise[j] * g[k][j];
      V.L[k][l] = sum;
    }
}

void Parity::open(const Robot& robot, const Knowledge& known, const Real* PH, Real* B) const {
  const int width = parameter_count(robot);
  for (int k : range(robot.r))
    for (int m : range(known.count)) B[k * known.count + m] = PH[k * width + known.column[m]];
  times_root(known, robot.r, B);
}

Real Parity::expectation_noise(const Extended& noise, int reading) const {
  Real sum = 0;
  if (reading >= n)
    for (int j : range(n)) sum += 2 * g[reading - n][j] * g[reading - n][j] * noise[j];
  return sqrt(sum);
}

Real chi_squared(const ReadingCovariance& V, int r, Reading parity) {
  V.whiten(r, parity.data(), 1);
  return sum_of(r, [&](int k) { return parity[k] * parity[k]; });
}

Outcome geometry_at(const Robot& robot, const Parity& parity, const Pose& pose, Real* PH,
                    Extended& beyond, Parasitic& rest) {
  beyond.fill(0);
  Extended q_e;
  PoseRows H_x;
  rest.left = cycle_steps(robot);
  const auto of = [&](const auto& at) -> Outcome {
    if constexpr (requires { at.built; })
      return linearise(robot, at.built, at.at, at.pose.theta, q_e, H_x, PH, &parity.g);
    else
      parameter_jacobian(robot, at, PH, &parity.g);
    return {};
  };
  const Outcome outcome = closed(level_of(robot), robot, pose, of, &rest);
  if (!outcome || !robot.rod_by_rod()) return outcome;
  Extended ideal;
  const Outcome also = extended(Level::ideal, robot, pose, ideal);
  for (int c = 0; also && c < readings(robot); ++c) beyond[c] = q_e[c] - ideal[c];
  return also;
}

}  // namespace truepose
