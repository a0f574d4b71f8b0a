// Deflection of rods, legs, belts and arms under load.
#include "simulation/stretch.hpp"

#include "calibration/dense.hpp"

namespace truepose {
namespace {
/// Computes the smallest tensions T (or torques) that hold w, G T = -w. @param G  each rod's row
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

/// The rods of a closed position at either level.
Outcome pull(const Robot& robot, const Joint& q, const Built& built, const engine::Position& at,
             const Load& load, Pull& pull) {
  const engine::Mechanism& m = built.mechanism;
  const engine::Frame& platform = at.frame[built.platform];
  const int freedoms = m.freedoms - m.motors, per = built.rods_per_chain;
  std::array<double, engine::kClosures> length, by_motor;
  RowMatrix G(m.closures, freedoms);
  engine::Row weight{};
  std::vector<double> T;
  const auto hang = [&](const Vec3& force, int body, const Vec3& point) {
    engine::add_line(m, at, body, engine::line_through(point, force), 1, weight);
  };
  hang(load.force, built.platform, platform.p);
  for (int k : range(robot.bodies)) {
    const Body& body = robot.body[k];
    int carrier = built.platform;
    for (int i = 0; i < m.motors && body.bar >= 0; ++i)
      if (robot.chain[i].bar == body.bar) carrier = built.bar[i];
    const Vec3 anchor = built.layout == Layout::ideal ? Vec3::Zero() : body.anchor;
    hang(body.mass * robot.gravity, carrier,
         platform.p + platform.R * body.pivot + at.frame[carrier].R * anchor);
  }
  for (int rod : range(m.closures)) {
    const int i = rod / per;
    hang(0.5 / per * robot.chain[i].rod_mass * robot.gravity, built.bar[i], at.A[rod]);
    const engine::Row row = engine::row(m, at, rod);
    length[rod] = (at.A[rod] - at.B[rod]).norm();
    by_motor[rod] = row[i] / length[rod];
    for (int j : range(freedoms)) G[rod][j] = -row[m.motors + j] / length[rod];
  }
  const auto w = weight.begin() + m.motors;
  // Of redundant motors the torques are the smallest (Jacobians), by_reading T + own.
  Joint by_reading{}, own{};
  for (int i = 0; i < m.motors && overdriven(robot); ++i) {
    const Driven driven = driven_point(robot.chain[i], q[i]);
    by_reading[i] = by_motor[i] * driven.rate;
    own[i] = weight_of_arm(robot, robot.chain[i], driven.dB);
    for (int j : range(freedoms)) w[j] -= own[i] * (G[i][j] /= by_reading[i]);
  }
  if (!held(G, {w, w + freedoms}, T)) return Status::singular;
  for (int i : range(m.motors)) {
    const Driven driven = driven_point(robot.chain[i], q[i]);
    double* of = T.data() + per * i;
    if (overdriven(robot)) *of = (*of - own[i]) / by_reading[i];
    const double sum = per == 1 ? of[0] : of[0] + of[1];
    pull.tension[i] = isnan(load.tension[i]) ? sum : load.tension[i];
    pull.rate[i] = driven.rate;
    pull.torque[i] = weight_of_arm(robot, robot.chain[i], driven.dB) / driven.rate;
    pull.length[i] = pull.difference[i] = 0;
    for (int side : range(per)) {
      const double tension = of[side] + (pull.tension[i] - sum) / per;
      const double growth = tension * length[per * i + side];
      pull.torque[i] += tension * by_motor[per * i + side];
      pull.length[i] += growth;
      if (per == 2) pull.difference[i] += side == 0 ? 2 * growth : -2 * growth;
    }
  }
  return {};
}
}  // namespace

Outcome pull(Level level, const Robot& robot, const Pose& pose, const Load& load, Pull& by) {
  if (!robot.finished) return Status::unfinished;
  FullClosure at;
  if (level == Level::full && robot.full.own()) {
    const Outcome outcome = ikm(robot, pose, at);
    return outcome ? pull(robot, at.q(), at.built, at.at, load, by) : outcome;
  }
  Closure ideal;
  const Outcome outcome = ikm(robot, pose, ideal);
  if (!outcome) return outcome;
  build(robot, Layout::ideal, at.built);
  at.at.y = stand(robot, at.built, ideal.q(), pose);
  engine::place(at.built.mechanism, at.at);
  return pull(robot, ideal.q(), at.built, at.at, load, by);
}

Outcome under_load(Level level, const Robot& robot, const Pose& pose, const Joint& compliance,
                   const Joint& arms, const Load& load, double* H_xi, UnderLoad& result) {
  const int n = robot.motors;
  Pull by;
  Outcome outcome = pull(level, robot, pose, load, by);
  if (!outcome) return outcome;
  // A leg's length is its motor's: growth at the same reading acts like an offset.
  const auto telescopic = [&](int i) { return robot.chain[i].actuator == Actuator::telescopic; };
  Robot longer = robot;
  for (int i : range(n)) {
    Chain& chain = longer.chain[i];
    const double length = compliance[i] * by.length[i];
    (telescopic(i) ? chain.encoder_offset : chain.rod) +=
        telescopic(i) ? length / by.rate[i] : length;
    chain.rod_difference += compliance[i] * by.difference[i];
    if (chain.actuator != Actuator::revolute) continue;
    const double by_arm = result.by_compliance[i][n + i] = chain.encoder_gain * by.torque[i];
    chain.encoder_offset -= arms[i] * by_arm;
  }
  PoseRows H_x;
  outcome = linearise(level, longer, pose, result.q_e, H_x, H_xi);
  if (!outcome) return outcome;
  result.tension = by.tension;
  for (int c : range(n + robot.r)) {
    const double* H = H_xi + c * parameter_count(robot);
    const auto along = [&](int i, ChainParameter parameter) {
      return H[chain_column(i) + int(parameter)];
    };
    for (int i : range(n))
      result.by_compliance[c][i] =
          (telescopic(i) ? along(i, ChainParameter::encoder_offset) * by.length[i] / by.rate[i]
                         : along(i, ChainParameter::rod) * by.length[i]) +
          along(i, ChainParameter::rod_difference) * by.difference[i];
  }
  return outcome;
}
}  // namespace truepose
