// The reduced dynamic model, in the platform's coordinates.
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
    for (int j : range(n)) {
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

Outcome dynamic_model(const Robot& robot, const Closure& closure, const Coordinates& rate,
                      DynamicModel& model, const Coordinates* acceleration) {
  const int n = model.n = dof(robot.mobility), m = model.motors = robot.motors;
  const bool M = acceleration == nullptr;
  const Carried& twists = closure.carried;
  const Twist twist = to_twist(twists, rate);
  Twist drift = drifting(twists, rate);  // acceleration of the platform: at ẍ = 0, or at ẍ
  if (!M) {
    const Twist known = to_twist(twists, *acceleration);
    drift.velocity += known.velocity;
    drift.omega += known.omega;
  }
  const Vec3 g = robot.gravity;
  for (int i : range(n)) {
    model.bias[i] = 0;
    for (int j = 0; j <= i && M; ++j) model.mass[i][j] = 0;
  }

  // Masses on the platform add up to one spatial inertia about D and one wrench.
  Real mass = 0;
  Vec3 first = Vec3::Zero();   // Σ m l
  Mat3 second = Mat3::Zero();  // Σ m l lᵀ
  Vec3 force = Vec3::Zero(), moment = Vec3::Zero();
  const auto hang = [&](Real own, const Vec3& l, const Vec3& f) {
    if (M) {
      mass += own;
      first += own * l;
      second += outer(own * l, l);
    }
    force += f;
    moment += l.cross(f);
  };

  for (int i : range(m)) {
    const Chain& chain = robot.chain[i];
    const ChainState& at = closure.chain[i];
    auto& k = model.k[i];
    jx_row(twists, at.v, at.lever, k.data());
    if (M && !(at.jq * at.jq > kSingular * at.v.squaredNorm() * at.dB.squaredNorm()))
      return {Status::singular, i};
    // The motor's true angle counts here, not an eccentric encoder's reading.
    const Real per_jq = at.rate / at.jq, slope = 1 / at.rate;
    const Vec3 dB = slope * at.dB;
    model.slope[i] = slope;
    Real qd = 0;
    for (int j : range(n)) {
      k[j] *= per_jq;
      qd += k[j] * rate[j];
    }
    model.rate[i] = qd;

    // Second derivative of the closure: q̈ = k ẍ + h. aA, aB: accelerations of A and B at ẍ = 0.
    const Vec3 swing = twist.omega.cross(at.lever);
    const Vec3 centripetal =  // acceleration of A at ẍ = 0
        twist.omega.cross(swing) + drift.velocity + drift.omega.cross(at.lever);
    const Vec3 stretch = dB * qd - twist.velocity - swing;  // v̇
    Vec3 aB = Vec3::Zero();
    Real right = at.v.dot(centripetal) - stretch.squaredNorm();
    if (chain.actuator == Actuator::revolute) {
      aB = -qd * qd * at.p;
      right -= at.v.dot(aB);
    } else if (chain.actuator == Actuator::telescopic) {
      right += qd * qd;
    }
    const Real h = right * per_jq;
    aB += dB * h;

    // Slender rod: virtual work of (m/6) [δB·(2B̈ + Ä) + δA·(B̈ + 2Ä)] - (m/2) (δB + δA)·g.
    const Real m2 = chain.rod_mass * 0.5, m3 = chain.rod_mass * (1.0 / 3), m6 = 0.5 * m3;
    const Vec3 fB = m3 * aB + m6 * centripetal - m2 * g;
    const Vec3 fA = m3 * centripetal + m6 * aB - m2 * g;
    hang(m3, at.lever, fA);
    const Real carried = chain.actuator == Actuator::revolute ? 0.5 : 1;  // arm's centre / carriage
    const Real own = chain.drive_inertia * h + dB.dot(fB - chain.arm_mass * carried * g);
    for (int row : range(n)) model.bias[row] += k[row] * own;
    if (!M) continue;
    Coordinates b;  // J_Aᵀ ∂B/∂q
    free_row(twists, dB, at.lever.cross(dB), b.data());
    const Real kk = chain.drive_inertia + m3 * dB.squaredNorm();
    for (int row : range(n)) {
      const Real kr = kk * k[row] + m6 * b[row], br = m6 * k[row];
      for (int column : range(row + 1)) model.mass[row][column] += kr * k[column] + br * b[column];
    }
  }

  const Mat3& R = closure.placed().R;
  Mat3 inertia = Mat3::Zero();  // of the bodies about their centres, platform frame
  for (int i : range(robot.bodies)) {
    const Body& body = robot.body[i];
    const Vec3 l = R * body.pivot;
    const Vec3 centripetal =
        twist.omega.cross(twist.omega.cross(l)) + drift.velocity + drift.omega.cross(l);
    hang(body.mass, l, body.mass * (centripetal - g));
    inertia += body.inertia;
  }
  inertia = R * inertia * R.transpose();
  moment += twist.omega.cross(inertia * twist.omega) + inertia * drift.omega;

  Coordinates wrench;
  free_row(twists, force, moment, wrench.data());
  for (int row : range(n)) model.bias[row] += wrench[row];
  if (!M) return {};

  // [m, -[Σml]×; [Σml]×, about D], its free rows and columns.
  const Mat3 about = inertia + second.trace() * Mat3::Identity() - second;
  const Mat3 cross =
      Mat3::of(0, -first.z(), first.y(), first.z(), 0, -first.x(), -first.y(), first.x(), 0);
  for (int row : range(n)) {
    if (is_rotational(robot.mobility)) {  // Tᵀ of all this T
      const Vec3 &linear = twists.linear[row], &turn = twists.axis[row];
      const Vec3 pushed = mass * linear + turn.cross(first);
      const Vec3 twisted = first.cross(linear) + about * turn;
      for (int column : range(row + 1)) {
        model.mass[row][column] +=
            pushed.dot(twists.linear[column]) + twisted.dot(twists.axis[column]);
        model.mass[column][row] = model.mass[row][column];
      }
    } else {
      const int i = free_columns(robot.mobility)[row];
      for (int column : range(row + 1)) {
        const int j = free_columns(robot.mobility)[column];
        if (i < 3)
          model.mass[row][column] += i == j ? mass : 0;
        else
          model.mass[row][column] += j < 3 ? cross(i - 3, j) : about(i - 3, j - 3);
        model.mass[column][row] = model.mass[row][column];
      }
    }
  }
  return {};
}

Joint motor_torques(int n, int motors, const Square& J, const Coordinates& force,
                    const Joint& slope) {
  Joint torque{};
  for (int i : range(n))
    for (int j : range(motors)) torque[j] += J[i][j] * force[i];
  for (int j : range(motors)) torque[j] *= slope[j];
  return torque;
}

Joint inverse_dynamics(const DynamicModel& model, const Square& J,
                       const Coordinates& acceleration) {
  const int n = model.n;
  Coordinates force = model.bias;
  for (int i : range(n))
    for (int j : range(n)) force[i] += model.mass[i][j] * acceleration[j];
  return motor_torques(n, model.motors, J, force, model.slope);
}

Square joint_inertia(const DynamicModel& model, const Square& J) {
  const int n = model.n;
  Square inertia{};
  const int motors = model.motors;
  for (int m : range(motors))
    for (int i : range(n))
      for (int j : range(n))
        for (int l : range(motors)) inertia[m][l] += J[i][m] * model.mass[i][j] * J[j][l];
  return inertia;
}

Outcome inverse_dynamics(const Robot& robot, const Pose& pose, const Coordinates& rate,
                         const Coordinates& acceleration, Joint& torque) {
  Closure closure;
  Jacobians jacobians;
  DynamicModel model;
  Outcome outcome = jacobian_at(robot, pose, closure, jacobians, false);
  if (outcome) outcome = dynamic_model(robot, closure, rate, model, &acceleration);
  if (!outcome) return outcome;
  torque = motor_torques(model.n, model.motors, jacobians.J, model.bias, model.slope);
  for (int i : range(robot.motors)) torque[i] += friction(robot.chain[i], model.rate[i]);
  if (!all_finite(torque, robot.motors)) return {Status::not_finite};
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
  for (int i : range(n))
    for (int j : range(n)) sum += mass[i][j] = model.mass[i][j];
  return isfinite(sum) ? outcome : Outcome{Status::not_finite};
}
}  // namespace truepose
