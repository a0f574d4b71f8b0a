// Jacobians between motions of platform and motors: J_x ẋ = J_q q̇, ẋ = J q̇.
#include "mechanism/jacobian.hpp"

#include "mechanism/full.hpp"

namespace truepose {
Unknowns jx_rows(const Closure& closure, const Joint& scale, Square& rows) {
  const Carried& carried = closure.carried;
  const int n = carried.n;
  const bool rotational = is_rotational(carried.mobility);
  Real velocity = 0, turn = 0;
  Unknowns size{};
  for (int i : range(closure.motors)) {
    const Vec3 v = scale[i] * closure.chain[i].v, &lever = closure.chain[i].lever;
    jx_row(carried, v, lever, rows[i].data());
    const Real v2 = v.squaredNorm();
    velocity += v2;
    turn += v2 * lever.squaredNorm();
    for (int j = 0; j < n && rotational; ++j)
      size[j] += v2 * (lever + carried.arm[j]).squaredNorm();
  }
  for (int j = 0; j < n && !rotational; ++j)
    size[j] = free_columns(carried.mobility)[j] < 3 ? velocity : turn;
  return size;
}

Unknowns jx_rows(const Closure& closure, Square& rows) {
  Joint ones;
  ones.fill(1);
  return jx_rows(closure, ones, rows);
}

Unknowns inverse_rows(const Closure& closure, Square& K) {
  Joint scale;
  for (int i : range(closure.motors)) scale[i] = 1 / closure.chain[i].jq;
  return jx_rows(closure, scale, K);
}

namespace {
/// J = K⁺; kept apart from the square J, whose stack is smaller.
[[gnu::noinline]] Outcome invert_rows(const Closure& closure, Jacobians& jacobians) {
  jacobians.sign = 0;
  Square K;
  const Unknowns sizes = inverse_rows(closure, K);
  const bool inverse = bool(invert(jacobians.motors, jacobians.n, K, sizes, jacobians.J));
  return {inverse ? Status::ok : Status::singular};
}
}  // namespace

Outcome jacobian(const Closure& closure, Jacobians& jacobians) {
  const int n = jacobians.n = closure.carried.n, m = jacobians.motors = closure.motors;
  const Unknowns size = jx_rows(closure, jacobians.jx);
  for (int i : range(m)) jacobians.jq[i] = closure.chain[i].jq;
  for (int i : range(m)) {
    const ChainState& at = closure.chain[i];
    if (!(at.jq * at.jq > kSingular * at.v.squaredNorm() * at.dB.squaredNorm()))
      return {Status::singular, i};
  }
  if (m > n) return invert_rows(closure, jacobians);
  const Inverted inverse = invert(n, n, jacobians.jx, size, jacobians.J);
  for (int i : range(n))
    for (int j : range(n)) jacobians.J[i][j] *= jacobians.jq[j];
  jacobians.sign = inverse.sign;
  return {inverse ? Status::ok : Status::singular};
}

Coordinates pose_rate(const Jacobians& at, const Joint& rate) {
  Coordinates result{};
  for (int i : range(at.n))
    result[i] = sum_of(at.motors, [&](int j) { return at.J[i][j] * rate[j]; });
  return result;
}

Outcome jacobian(const Robot&, const Closure& closure, JointMatrix& J) {
  Jacobians jacobians;
  const Outcome outcome = jacobian(closure, jacobians);
  if (!outcome) return outcome;
  Real sum = 0;  // becomes NaN if any value is
  for (int i : range(jacobians.n))
    for (int j : range(jacobians.motors)) sum += J[i][j] = jacobians.J[i][j];
  return {isfinite(sum) ? Status::ok : Status::not_finite};
}

Outcome note_assembly(Robot& robot) {
  if (is_mechanism(robot.mobility)) return note_home(robot);
  Closure closure;
  Jacobians jacobians;
  const Outcome outcome =
      jacobian_at(robot, to_pose(robot.mobility, robot.home), closure, jacobians);
  if (outcome) robot.assembly_sign = jacobians.sign;
  return outcome ? within_limits(robot, closure.pose, closure.q()) : outcome;
}

Outcome finish(Robot& robot) {
  robot.finished = false;
  const Outcome exist = parts_exist(robot);
  if (!exist) return exist;
  const int n = dof(robot.mobility);
  if (robot.chains != robot.motors || robot.motors < n) return {Status::not_square};
  // No parallelogram keeps a bar's orientation on a platform that turns about more than z.
  for (int i = 0; i < robot.motors && robot.mobility >= Mobility::spatial; ++i)
    if (robot.chain[i].bar >= 0 || robot.chain[i].anchor.squaredNorm() > 0)
      return {Status::no_such_part, i};
  robot.finished = true;
  note_encoders(robot);
  note_vertical(robot);
  robot.limited = false;
  robot.assembly_sign = 0;
  const auto limits = [&](const auto& of) {
    robot.limited = robot.limited || isfinite(of.low) || isfinite(of.high);
  };
  for (int i : range(robot.motors)) limits(robot.chain[i]);
  for (int j : range(passive_axes(robot.mobility))) limits(robot.axis[j]);
  return note_assembly(robot);
}
}  // namespace truepose
