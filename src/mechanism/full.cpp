// The full level of the model: every rod by itself, a platform that tilts, bars that turn.
#include "mechanism/full.hpp"

#include "mechanism/angles_of.hpp"

namespace truepose {
namespace {
/// Closes a described mechanism's loops from its home, the held freedoms moved in stages, in at
/// most `most` steps together.
FkmResult close_from_home(const engine::Mechanism& m, const engine::Freedoms& unknown, int most,
                          engine::Position& at) {
  const engine::Row end = at.y;
  at.y = m.home;
  return in_stages(most, [&](Real rest, int left) {
    engine::Row y = end;
    for (int j : range(m.freedoms)) y[j] -= rest * (end[j] - m.home[j]);
    for (int k : range(unknown.count)) y[unknown.index[k]] = at.y[unknown.index[k]];
    at.y = y;
    return engine::close(m, at, unknown, left);
  });
}

/// Closes the rods for the unknown freedoms from the start in `closure`, and reads pose and motors
/// off. @param near  θ nearby, and ψ where there are no bars
FkmResult close_rods(const Robot& robot, const FullPose& near, const engine::Freedoms& unknown,
                     int cap, bool start_closed, FullClosure& closure) {
  const Built& built = closure.built;
  engine::Position& at = closure.at;
  const engine::Row start = at.y;
  FkmResult result =
      engine::close(built.mechanism, at, unknown, min(kFkmIterations, cap), start_closed);
  const bool described = is_mechanism(robot.mobility);
  const int left = min(kFkmIterations, cap - result.iterations);
  if (described && !result && result.status != Status::not_finite && left > 0) {
    engine::Position again = at;
    again.y = start;
    const FkmResult staged = close_from_home(built.mechanism, unknown, left, again);
    if (staged) at = again;
    result = {staged ? staged : result, result.iterations + staged.iterations, at.residual};
  }
  if (result.chain >= 0) result.chain /= built.rods_per_chain;
  const engine::Frame& platform = at.frame[built.platform];
  closure.pose = {{platform.p, platform.R, theta_of(platform.R, near.theta)}, near.psi};
  if (described) closure.pose.D = near.D;  // which holds x
  for (int j = 0; j < dof(robot.mobility) && described; ++j)
    closure.pose.D[j] = at.y[built.mechanism.motors + j];
  for (int k : range(robot.full.bars)) closure.pose.psi[k] = at.y[built.turn_of(robot, k)];
  for (int i : range(robot.motors)) closure.motors[i] = motor_reading(robot.chain[i], at.y[i]);
  return result;
}

/// The mechanism at home as the ideal level has it.
Outcome at_home(const Robot& robot, Layout layout, FullClosure& home) {
  Closure ideal;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, robot.home), ideal);
  if (!outcome) return outcome;
  build(robot, layout, home.built);
  home.at.y = stand(robot, home.built, ideal.q(), ideal.pose);
  engine::place(home.built.mechanism, home.at);
  return outcome;
}
}  // namespace

void FullClosure::note(const engine::Row& ideal, Parasitic& rest) const {
  rest.known = true;
  for (int j : range(built.mechanism.freedoms)) rest.y[j] = at.y[j] - ideal[j];
}

FullPose to_full(const Pose& pose) {
  FullPose full{pose, {}};
  full.psi.fill(-pose.theta);
  return full;
}

Outcome full_rows(const Robot& robot, std::array<engine::Row, engine::kClosures>& rows) {
  FullClosure home;
  const Outcome outcome = at_home(robot, Layout::free, home);
  const engine::Mechanism& m = home.built.mechanism;
  for (int rod = 0; rod < m.closures && outcome; ++rod) {
    const engine::Row row = engine::row(m, home.at, rod);
    std::copy(row.begin() + m.motors, row.begin() + m.freedoms, rows[rod].begin());
    if (robot.bar_joint == BarJoint::four_bar && m.freedoms > home.built.turn + 1)
      rows[rod][6] += rows[rod][7];
  }
  return outcome;
}

Outcome note_home(Robot& robot) {
  FullClosure home;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, robot.home), home);
  JointMatrix J;
  const Outcome regular = outcome ? jacobian(robot, home, J) : outcome;
  if (!regular) return regular;
  robot.mechanism.home = home.at.y;
  robot.assembly_sign = engine::mode_of(home.built.mechanism, home.at);
  return within_limits(robot, home.pose, home.q());
}

Outcome finish_full(Robot& robot) {
  if (!robot.finished) return {Status::unfinished};
  const int n = dof(robot.mobility), motors = robot.motors;
  FullLevel& level = robot.full = {};
  bool described = true;
  for (int i : range(motors)) {
    level.bars = max(level.bars, robot.chain[i].bar + 1);
    described = described && robot.chain[i].rod_spacing > 0;
  }
  if (!paired(robot.mobility)) {
    level.kind = FullKind::same;
    level.rods = is_mechanism(robot.mobility) ? robot.mechanism.closures : motors;
    level.unknowns = n;
    return {};
  }
  if (!described || level.bars > kMaxBars) return {};
  const bool together = robot.bar_joint == BarJoint::four_bar;
  level.rods = 2 * motors;
  level.unknowns = 6 + (together ? min(1, level.bars) : level.bars);
  level.excess = level.rods - level.unknowns;
  level.kind = FullKind::loose;
  if (level.excess < 0) {
    level.excess = -level.excess;
    return {};
  }
  std::array<engine::Row, engine::kClosures> rows;
  Outcome outcome = full_rows(robot, rows);
  if (!outcome) return outcome;
  const int held = engine::rank(rows, level.rods, level.unknowns);
  if (held < level.unknowns) {
    level.excess = level.unknowns - held;
  } else if (level.excess > 0) {
    level.kind = level.excess == 1 ? FullKind::elastic : FullKind::overconstrained;
  } else {
    FullClosure home;
    outcome = at_home(robot, Layout::full, home);
    level.kind = FullKind::exists;
    level.sign = engine::mode_of(home.built.mechanism, home.at);
  }
  return {};
}

FkmResult fkm(const Robot& robot, const Joint& q, FullPose& pose, FullClosure& closure, int cap,
              const Parasitic& rest) {
  if (!robot.finished) return {{Status::unfinished}};
  for (int i : range(robot.motors))
    if (!isfinite(q[i])) return {{Status::not_finite, i}};
  build(robot, Layout::full, closure.built);
  const engine::Mechanism& m = closure.built.mechanism;
  closure.at.y = stand(robot, closure.built, q, pose);
  for (int j : range(m.motors + m.coordinates, m.freedoms)) closure.at.y[j] += rest.y[j];
  FkmResult result = close_rods(robot, pose, engine::forward(m), cap, false, closure);
  pose = closure.pose;
  if (result && other_mode(m.sign, engine::mode_of(m, closure.at)))
    result.status = Status::branch_lost;
  return result;
}

namespace {
/// Where the search for the motors at a pose starts: at the ideal level's, or at home's.
Outcome start_at(const Robot& robot, const Pose& pose, Built& built, engine::Row& start) {
  if (!robot.finished) return {Status::unfinished};
  build(robot, Layout::full, built);
  Joint q{};
  Closure ideal;
  const bool described = is_mechanism(robot.mobility);
  const Outcome outcome = described ? Outcome{} : ikm(robot, pose, ideal);
  for (int i : range(robot.motors))
    q[i] = described ? motor_reading(robot.chain[i], robot.mechanism.home[i]) : ideal.chain[i].q;
  if (outcome) start = stand(robot, built, q, pose);
  return outcome;
}
}  // namespace

FkmResult ikm(const Robot& robot, const Pose& pose, FullClosure& closure, Parasitic* rest) {
  engine::Row start;
  const Outcome outcome = start_at(robot, pose, closure.built, start);
  if (!outcome) return {outcome};
  const engine::Freedoms unknown = engine::inverse(closure.built.mechanism);
  FkmResult result{{Status::not_converged}};
  Parasitic alone;
  if (!rest) rest = &alone;
  for (bool near = rest->known; rest->most(near) > 0; near = false) {
    closure.at.y = start;
    for (int k = 0; k < unknown.count && near; ++k)
      closure.at.y[unknown.index[k]] += rest->y[unknown.index[k]];
    result = close_rods(robot, to_full(pose), unknown, rest->most(near), near, closure);
    rest->take(result.iterations);
    if (result || !near) break;
  }
  if (result) closure.note(start, *rest);
  return result;
}

Outcome jacobian(const Robot& robot, const FullClosure& closure, JointMatrix& J) {
  const engine::Mechanism& m = closure.built.mechanism;
  const int n = m.coordinates;
  engine::Freedoms x;
  x.add(m.motors, m.motors + n);
  Matrix<kMaxUnknowns, kMaxUnknowns> rates;
  Outcome outcome = engine::follow(m, closure.at, engine::inverse(m), x, rates);
  if (outcome.chain >= 0) outcome.chain /= closure.built.rods_per_chain;
  Square K, inverse;  // K = ∂q/∂x
  Unknowns size{};
  for (int j = 0; j < m.motors && outcome; ++j) {
    const Real slope = encode(robot.chain[j], closure.at.y[j]).slope;
    if (slope == 0) return {Status::singular, j};  // its encoder does not see the motor
    for (int i : range(n)) {
      K[j][i] = rates[j][i] * slope;
      size[i] += K[j][i] * K[j][i];
    }
  }
  if (outcome && !invert(m.motors, n, K, size, inverse)) return {Status::singular};
  Real sum = 0;  // becomes NaN if any value is
  for (int j = 0; j < m.motors && outcome; ++j)
    for (int i : range(n)) sum += J[i][j] = inverse[i][j];
  if (outcome && !isfinite(sum)) outcome.status = Status::not_finite;
  return outcome;
}

Outcome read_standing(const Robot& robot, const FullPose& pose, const Joint& motor,
                      const Joint& arm, Extended& q_e) {
  if (!robot.finished) return {Status::unfinished};
  const int m = robot.motors;
  FullClosure there;
  build(robot, Layout::free, there.built);
  Joint q{};
  for (int i : range(m)) q[i] = motor_reading(robot.chain[i], arm[i]);
  there.at.y = stand(robot, there.built, q, pose);
  for (int j : range(there.built.turn, there.built.mechanism.freedoms))
    there.at.y[j] = pose.psi[j - there.built.turn];
  engine::place(there.built.mechanism, there.at);
  Outcome outcome = read(robot, there.built, there.at, theta_of(pose.R, pose.theta), q_e);
  for (int i : range(m)) q_e[i] = motor_reading(robot.chain[i], motor[i]);
  if (!is_rotational(robot.mobility)) return outcome;
  Pose angles = to_pose(robot.mobility, robot.home);
  angles_of(robot, {pose.D, pose.R, 0}, angles);
  for (int k : range(robot.r))
    if (const Sensor& sensor = robot.sensor[k]; sensor.kind == SensorKind::axis_angle)
      q_e[m + k] = sensor.gain * sense_axis(sensor, angles).value - sensor.offset;
  return {all_finite(q_e, m + robot.r) ? Status::ok : Status::not_finite};
}
}  // namespace truepose
