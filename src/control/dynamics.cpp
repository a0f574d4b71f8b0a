#include "control/dynamics.hpp"

namespace truepose {
Twist drifting(const Carried& carried, const Coordinates& rate) {
  Twist drift;
  if (is_rotational(carried.mobility)) {
    const int n = carried.n;
    std::array<Vec3, kMaxAxes> swept;  // velocity of D relative to p_j, by the axes from j on
    Vec3 after = Vec3::Zero();
    for (int j = n - 1; j >= 0; --j) {
      swept[j] = after + rate[j] * carried.linear[j];
      after = swept[j];
    }
    Vec3 omega = Vec3::Zero();  // of the frame that carries axis j
    for (int j = 0; j < n; ++j) {
      const Vec3 turned = omega.cross(carried.axis[j]);
      // D - p_j changes by the turn of the frame and by the axes from j on.
      const Vec3 arm = omega.cross(carried.arm[j]) + swept[j];
      drift.omega += rate[j] * turned;
      drift.velocity += rate[j] * (turned.cross(carried.arm[j]) + carried.axis[j].cross(arm));
      omega += rate[j] * carried.axis[j];
    }
  }
  return drift;
}

Joint motor_torques(int n, const Square& J, const Coordinates& force, const Joint& slope) {
  Joint torque{};
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) torque[j] += J[i][j] * force[i];
  for (int j = 0; j < n; ++j) torque[j] *= slope[j];
  return torque;
}

Joint inverse_dynamics(const DynamicModel& model, const Square& J,
                       const Coordinates& acceleration) {
  const int n = model.n;
  Coordinates force = model.bias;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) force[i] += model.mass[i][j] * acceleration[j];
  return motor_torques(n, J, force, model.slope);
}

Coordinates pose_rate(const Jacobians& at, const Joint& rate) {
  Coordinates result{};
  for (int i = 0; i < at.n; ++i)
    result[i] = sum_of(at.n, [&](int j) { return at.J[i][j] * rate[j]; });
  return result;
}

Square joint_inertia(const DynamicModel& model, const Square& J) {
  const int n = model.n;
  Square inertia{};
  for (int m = 0; m < n; ++m)
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j)
        for (int l = 0; l < n; ++l) inertia[m][l] += J[i][m] * model.mass[i][j] * J[j][l];
  return inertia;
}

Outcome inverse_dynamics(const Robot& robot, const Pose& pose, const Coordinates& rate,
                         const Coordinates& acceleration, Joint& torque) {
  Closure closure;
  Jacobians jacobians;
  DynamicModel model;
  Outcome outcome = ikm(robot, pose, closure, false);
  if (outcome) outcome = jacobian(closure, jacobians);
  if (outcome) outcome = dynamic_model(robot, closure, rate, model);
  if (!outcome) return outcome;
  torque = inverse_dynamics(model, jacobians.J, acceleration);
  for (int i = 0; i < dof(robot.mobility); ++i)
    torque[i] += friction(robot.chain[i], model.rate[i]);
  if (!all_finite(torque, dof(robot.mobility))) return {Status::not_finite, -1};
  return outcome;
}

Outcome mass_matrix(const Robot& robot, const Pose& pose, PoseMatrix& mass) {
  const int n = dof(robot.mobility);
  Closure closure;
  DynamicModel model;
  Outcome outcome = ikm(robot, pose, closure, false);
  if (outcome) outcome = dynamic_model(robot, closure, Coordinates{}, model);
  if (!outcome) return outcome;
  Real sum = 0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) sum += mass[i][j] = model.mass[i][j];
  return std::isfinite(sum) ? outcome : Outcome{Status::not_finite, -1};
}
}  // namespace truepose
