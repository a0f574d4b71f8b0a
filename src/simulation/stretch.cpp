#include "simulation/stretch.hpp"

namespace truepose {
bool held(const Eigen::MatrixXd& G, const Eigen::VectorXd& w, Eigen::VectorXd& T) {
  const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> rods(G);
  T = rods.solve(-w);
  return rods.rank() == G.rows() && T.allFinite();
}

Outcome pull(const Robot& robot, const Closure& at, const Load& load, Pull& pull) {
  const int n = dof(robot.mobility);
  Eigen::MatrixXd G(n, n);
  Eigen::VectorXd w = Eigen::VectorXd::Zero(n), T;
  Coordinates row;
  const auto hang = [&](const Vec3& force, const Vec3& lever) {
    free_row(at.carried, force, lever.cross(force), row.data());
    w += Eigen::Map<const Eigen::VectorXd>(row.data(), n);
  };
  hang(load.force, Vec3::Zero());
  for (int k = 0; k < robot.bodies; ++k)
    hang(robot.body[k].mass * robot.gravity, at.placed().R * robot.body[k].pivot);
  for (int i = 0; i < n; ++i) {
    const ChainState& chain = at.chain[i];
    hang(0.5 * robot.chain[i].rod_mass * robot.gravity, chain.lever);
    jx_row(at.carried, chain.v, chain.lever, row.data());
    G.col(i) = Eigen::Map<const Eigen::VectorXd>(row.data(), n) / chain.v.norm();
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

Outcome pull(const Robot& robot, const FullClosure& closure, const Load& load, Pull& pull) {
  const int n = dof(robot.mobility);
  const Built& built = closure.built;
  const engine::Mechanism& m = built.mechanism;
  const engine::Position& at = closure.at;
  const int freedoms = m.freedoms - m.motors;
  std::array<double, engine::kClosures> length, by_motor;
  Eigen::MatrixXd G(freedoms, m.closures);
  engine::Row weight{};
  Eigen::VectorXd T;
  const auto hang = [&](const Vec3& force, int body, const Vec3& point) {
    engine::add_line(m, at, body, engine::line_through(point, force), 1, weight);
  };
  hang(load.force, built.platform, closure.pose.D);
  for (int k = 0; k < robot.bodies; ++k) {
    const Body& body = robot.body[k];
    const Vec3 pivot = closure.pose.D + closure.pose.R * body.pivot;
    const Vec3 force = body.mass * robot.gravity;
    if (body.bar < 0) {
      hang(force, built.platform, pivot + closure.pose.R * body.anchor);
      continue;
    }
    for (int i = 0; i < n; ++i) {  // any chain on its bar
      if (robot.chain[i].bar != body.bar) continue;
      hang(force, built.bar[i], pivot + at.frame[built.bar[i]].R * body.anchor);
      break;
    }
  }
  for (int rod = 0; rod < m.closures; ++rod) {
    hang(0.25 * robot.chain[rod / 2].rod_mass * robot.gravity, built.bar[rod / 2], at.A[rod]);
    const engine::Row row = engine::row(m, at, rod);
    length[rod] = (at.A[rod] - at.B[rod]).norm();
    by_motor[rod] = row[rod / 2];
    for (int j = 0; j < freedoms; ++j) G(j, rod) = -row[m.motors + j] / length[rod];
  }
  if (!held(G, Eigen::Map<const Eigen::VectorXd>(weight.data() + m.motors, freedoms), T))
    return {Status::singular, -1};
  for (int i = 0; i < n; ++i) {
    const Driven driven = driven_point(robot.chain[i], closure.q[i]);
    Real of[2] = {T[2 * i], T[2 * i + 1]}, sum = of[0] + of[1];
    if (!std::isnan(load.tension[i])) {
      for (Real& one : of) one += 0.5 * (load.tension[i] - sum);
      sum = load.tension[i];
    }
    pull.torque[i] = weight_of_arm(robot, robot.chain[i], driven.dB);
    for (int side = 0; side < 2; ++side) {
      pull.torque[i] += of[side] * by_motor[2 * i + side] * driven.rate / length[2 * i + side];
      of[side] *= length[2 * i + side];
    }
    pull.torque[i] /= driven.rate;
    pull.tension[i] = sum;
    pull.length[i] = of[0] + of[1];
    pull.difference[i] = 2 * (of[0] - of[1]);
    pull.rate[i] = driven.rate;
  }
  return {};
}

Outcome pull(const Robot& robot, const Pose& pose, bool full, const Load& load, Pull& by) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (full && robot.full.own()) {
    FullClosure at;
    const Outcome outcome = ikm_full(robot, pose, at);
    return outcome ? pull(robot, at, load, by) : outcome;
  }
  Closure at;
  const Outcome outcome = ikm(robot, pose, at);
  return outcome ? pull(robot, at, load, by) : outcome;
}

Outcome under_load(const Robot& robot, const Kernels& model, bool full, const Pose& pose,
                   const Joint& compliance, const Joint& arms, const Load& load, double* H_xi,
                   UnderLoad& result) {
  Pull by;
  Outcome outcome = pull(robot, pose, full, load, by);
  if (!outcome) return outcome;
  // A leg's length is its motor's: growth at the same reading acts like an offset.
  const auto telescopic = [&](int i) { return robot.chain[i].actuator == Actuator::telescopic; };
  Robot longer = robot;
  for (int i = 0; i < model.n; ++i) {
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
  outcome = model.linearise(longer, pose, result.q_e, H_x, H_xi, rest);
  if (!outcome) return outcome;
  result.tension = by.tension;
  for (int c = 0; c < model.n + robot.r; ++c) {
    const double* H = H_xi + c * parameter_count(robot);
    const auto along = [&](int i, ChainParameter parameter) {
      return H[chain_column(i) + static_cast<int>(parameter)];
    };
    for (int i = 0; i < model.n; ++i)
      result.by_compliance[c][i] =
          (telescopic(i) ? along(i, ChainParameter::encoder_offset) * by.length[i] / by.rate[i]
                         : along(i, ChainParameter::rod) * by.length[i]) +
          along(i, ChainParameter::rod_difference) * by.difference[i];
  }
  return outcome;
}
}  // namespace truepose
