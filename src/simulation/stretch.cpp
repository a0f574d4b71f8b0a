#include "simulation/stretch.hpp"

#include "calibration/dense.hpp"

namespace truepose {
namespace {
/// Computes the smallest tensions T that hold w, G T = -w. @param G  each rod's row
/// @return whether every load can be held
bool held(const RowMatrix& G, const std::vector<double>& w, std::vector<double>& T) {
  const SingularValues rods = singular_values(G);
  T = transposed(rods.inverse()) * w;
  for (double& tension : T) tension = -tension;
  return rods.rank() == G.cols() && all_finite(T, G.rows());
}

/// A revolute motor's torque, by rate, against the weight of its arm and half of its rods.
Real weight_of_arm(const Robot& robot, const Chain& chain, const Vec3& dB) {
  return -0.5 * (chain.arm_mass + chain.rod_mass) * robot.gravity.dot(dB);
}

/// Ideal level.
Outcome pull(const Robot& robot, const Closure& at, const Load& load, Pull& pull) {
  const int n = dof(robot.mobility);
  RowMatrix G(n, n);
  std::vector<double> w(n), T;
  Coordinates row;
  const auto hang = [&](const Vec3& force, const Vec3& lever) {
    free_row(at.carried, force, lever.cross(force), row.data());
    add_scaled(n, 1, row.data(), w.data());
  };
  hang(load.force, Vec3::Zero());
  for (int k = 0; k < robot.bodies; ++k)
    hang(robot.body[k].mass * robot.gravity, at.placed().R * robot.body[k].pivot);
  for (int i = 0; i < n; ++i) {
    const ChainState& chain = at.chain[i];
    hang(0.5 * robot.chain[i].rod_mass * robot.gravity, chain.lever);
    jx_row(at.carried, chain.v, chain.lever, row.data());
    add_scaled(n, 1 / chain.v.norm(), row.data(), G[i]);
  }
  if (!held(G, w, T)) return {Status::singular, -1};
  for (int i = 0; i < n; ++i) {
    pull.tension[i] = std::isnan(load.tension[i]) ? T[i] : load.tension[i];
    pull.length[i] = pull.tension[i] * at.chain[i].v.norm();
    pull.difference[i] = 0;
    pull.rate[i] = at.chain[i].rate;
    pull.torque[i] = (pull.tension[i] * at.chain[i].jq / at.chain[i].v.norm() +
                      weight_of_arm(robot, robot.chain[i], at.chain[i].dB)) /
                     pull.rate[i];
  }
  return {};
}

/// Full level.
Outcome pull(const Robot& robot, const FullClosure& at, const Load& load, Pull& pull) {
  const int n = dof(robot.mobility), N = rods_of(robot);
  const bool together = bars_together(robot, robot.full.bars);
  const Mat3& R = at.pose.R;
  RowMatrix G(N, robot.full.unknowns);
  std::vector<double> w(8), T;
  const auto hang = [&](const Vec3& force, const Vec3& pivot, const Vec3& arm, int bar) {
    const Vec3 moment = (pivot + arm).cross(force);
    for (int k = 0; k < 3; ++k) {
      w[k] += force[k];
      w[3 + k] += moment[k];
    }
    if (bar >= 0) w[together ? 6 : 6 + bar] += R.col(2).dot(arm.cross(force));
  };
  hang(load.force, Vec3::Zero(), Vec3::Zero(), -1);
  for (int k = 0; k < robot.bodies; ++k) {
    const Body& body = robot.body[k];
    const Mat3 turned = body.bar < 0 ? R : R * rotation_z(at.pose.psi[body.bar]);
    hang(body.mass * robot.gravity, R * body.pivot, turned * body.anchor, body.bar);
  }
  for (int rod = 0; rod < N; ++rod) {
    const Chain& chain = robot.chain[rod / 2];
    hang(0.25 * chain.rod_mass * robot.gravity, at.lever[rod] - at.arm[rod], at.arm[rod],
         chain.bar);
    std::array<Real, kMaxUnknowns> row;
    full_row(robot, at, rod, row);
    if (together) row[6] += row[7];
    add_scaled(G.cols(), 1 / at.v[rod].norm(), row.data(), G[rod]);
  }
  w.resize(G.cols());
  if (!held(G, w, T)) return {Status::singular, -1};
  for (int i = 0; i < n; ++i) {
    Real of[2] = {T[2 * i], T[2 * i + 1]}, sum = of[0] + of[1];
    if (!std::isnan(load.tension[i])) {
      for (Real& one : of) one += 0.5 * (load.tension[i] - sum);
      sum = load.tension[i];
    }
    pull.torque[i] = weight_of_arm(robot, robot.chain[i], at.driven[i].dB);
    for (int side = 0; side < 2; ++side) {
      const Real length = at.v[2 * i + side].norm();
      pull.torque[i] += of[side] * at.jq[2 * i + side] / length;
      of[side] *= length;
    }
    pull.torque[i] /= at.driven[i].rate;
    pull.tension[i] = sum;
    pull.length[i] = of[0] + of[1];
    pull.difference[i] = 2 * (of[0] - of[1]);
    pull.rate[i] = at.driven[i].rate;
  }
  return {};
}

}  // namespace

Outcome pull(Level level, const Robot& robot, const Pose& pose, const Load& load, Pull& by) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (level == Level::full && robot.full.own()) {
    FullClosure at;
    const Outcome outcome = ikm_full(robot, pose, at);
    return outcome ? pull(robot, at, load, by) : outcome;
  }
  Closure at;
  const Outcome outcome = ikm(robot, pose, at);
  return outcome ? pull(robot, at, load, by) : outcome;
}

Outcome under_load(Level level, const Robot& robot, const Pose& pose, const Joint& compliance,
                   const Joint& arms, const Load& load, double* H_xi, UnderLoad& result) {
  const int n = dof(robot.mobility);
  Pull by;
  Outcome outcome = pull(level, robot, pose, load, by);
  if (!outcome) return outcome;
  // A leg's length is its motor's: growth at the same reading acts like an offset.
  const auto telescopic = [&](int i) { return robot.chain[i].actuator == Actuator::telescopic; };
  Robot longer = robot;
  for (int i = 0; i < n; ++i) {
    Chain& chain = longer.chain[i];
    const double length = compliance[i] * by.length[i];
    (telescopic(i) ? chain.encoder_offset : chain.rod) +=
        telescopic(i) ? length / by.rate[i] : length;
    chain.rod_difference += compliance[i] * by.difference[i];
    result.by_arm[i] = chain.actuator == Actuator::revolute ? chain.encoder_gain * by.torque[i] : 0;
    chain.encoder_offset -= arms[i] * result.by_arm[i];
  }
  PoseRows H_x;
  Parasitic rest;
  outcome = linearise(level, longer, pose, result.q_e, H_x, H_xi, rest);
  if (!outcome) return outcome;
  result.tension = by.tension;
  for (int c = 0; c < n + robot.r; ++c) {
    const double* H = H_xi + c * parameter_count(robot);
    const auto along = [&](int i, ChainParameter parameter) {
      return H[chain_column(i) + static_cast<int>(parameter)];
    };
    for (int i = 0; i < n; ++i)
      result.by_compliance[c][i] =
          (telescopic(i) ? along(i, ChainParameter::encoder_offset) * by.length[i] / by.rate[i]
                         : along(i, ChainParameter::rod) * by.length[i]) +
          along(i, ChainParameter::rod_difference) * by.difference[i];
  }
  return outcome;
}
}  // namespace truepose
