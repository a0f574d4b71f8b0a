// Robots as mechanisms of the engine: y = [motors; x; hidden freedoms].
#include "mechanism/build.hpp"

namespace truepose {
namespace {
/// Adds bodies one by one, each with freedoms of its own.
struct Builder {
  engine::Mechanism& m;

  int add(const engine::Body& body) {
    m.body[m.bodies] = body;
    m.freedoms = max(m.freedoms, body.freedom + body.count);
    return m.bodies++;
  }
  int hinge(int parent, const Vec3& origin, const Vec3& axis) {
    return add({engine::Kind::hinge, parent, m.freedoms, 1, origin, axis});
  }
};

/// The joints that carry the platform, and the freedom of its yaw.
void carry_platform(const Robot& robot, Builder builder, Built& built) {
  const Mobility mobility = robot.mobility;
  int& platform = built.platform = -1;
  built.yaw = -1;
  if (is_rotational(mobility) && built.layout != Layout::free) {
    for (int j : range(passive_axes(mobility)))
      platform = builder.hinge(platform, robot.axis[j].origin, robot.axis[j].direction);
    return;
  }
  const bool free = built.layout == Layout::free, full = built.layout == Layout::full;
  const int positions = free ? 3 : positions_of(mobility);
  platform = builder.add({engine::Kind::shift, -1, builder.m.freedoms, positions});
  if (free || mobility == Mobility::spatial)
    platform = builder.add({engine::Kind::ball, platform, builder.m.freedoms, 3});
  else if (turns_about_z(mobility) || full)
    platform = builder.hinge(platform, Vec3::Zero(), Vec3::UnitZ());
  if (!free && (turns_about_z(mobility) || full)) built.yaw = builder.m.freedoms - 1;
  if (!full) return;
  platform = builder.hinge(platform, Vec3::Zero(), Vec3::UnitY());  // hidden: it tilts
  platform = builder.hinge(platform, Vec3::Zero(), Vec3::UnitX());
}

/// The body that carries A of chain i: the platform, or a bar that turns about z at c.
int carrier(const Robot& robot, int i, Builder builder, const Built& built) {
  const Chain& chain = robot.chain[i];
  if (built.layout == Layout::ideal) {
    const bool keeps = chain.bar >= 0 || chain.anchor.squaredNorm() > 0;
    if (!turns_about_z(robot.mobility) || !keeps) return built.platform;
    return builder.add(
        {engine::Kind::hinge, built.platform, built.yaw, 1, chain.pivot, Vec3::UnitZ(), -1});
  }
  if (chain.bar < 0) return built.platform;
  for (int k : range(i))
    if (robot.chain[k].bar == chain.bar && (robot.chain[k].pivot - chain.pivot).squaredNorm() == 0)
      return built.bar[k];
  const int freedom = built.turn_of(robot, chain.bar);
  return builder.add({engine::Kind::hinge, built.platform, freedom, 1, chain.pivot, Vec3::UnitZ()});
}
}  // namespace

void build(const Robot& robot, Layout layout, Built& built) {
  const int n = dof(robot.mobility), motors = robot.motors;
  built.layout = layout;
  built.rods_per_chain = layout == Layout::ideal ? 1 : 2;
  engine::Mechanism& m = built.mechanism;
  if (is_mechanism(robot.mobility)) {
    m = robot.mechanism;
    m.sign = robot.assembly_sign;
    built.rods_per_chain = 1;
    built.platform = m.platform;
    built.yaw = -1;
    built.turn = m.freedoms;
    return;
  }
  Builder builder{m};
  m.bodies = m.closures = 0;
  m.motors = m.freedoms = motors;
  m.coordinates = layout == Layout::free ? 6 : n;
  m.elastic = layout == Layout::full && robot.full.kind == FullKind::elastic;
  m.sign = layout == Layout::full ? robot.full.sign : robot.assembly_sign;
  for (int i : range(motors)) {
    const Chain& chain = robot.chain[i];
    const engine::Kind kind =
        chain.actuator == Actuator::revolute ? engine::Kind::hinge : engine::Kind::slide;
    const bool leg = chain.actuator == Actuator::telescopic;
    built.arm[i] = leg ? -1 : builder.add({kind, -1, i, 1, chain.base, chain.axis});
  }
  carry_platform(robot, builder, built);
  built.turn = m.freedoms;
  for (int i : range(motors)) {
    const Chain& chain = robot.chain[i];
    const bool leg = chain.actuator == Actuator::telescopic;
    const int bar = built.bar[i] = carrier(robot, i, builder, built);
    const Vec3 A = bar == built.platform ? chain.pivot + chain.anchor : chain.anchor;
    const Vec3 B = leg                                    ? chain.base
                   : chain.actuator == Actuator::revolute ? chain.arm * chain.zero
                                                          : Vec3::Zero();
    for (int rod : range(built.rods_per_chain)) {
      const Real half = built.rods_per_chain == 1 ? 0 : rod == 0 ? 0.5 : -0.5;
      engine::Closure& closure = m.closure[m.closures++];
      closure.body_a = bar;
      closure.body_b = built.arm[i];
      closure.a = A + half * chain.rod_spacing * chain.pair_drawn;
      closure.b = B + half * chain.rod_spacing * pair_direction(chain);
      closure.length = (leg ? 0 : chain.rod) + half * chain.rod_difference;
      closure.compliance = chain.rod * chain.rod;
      (leg ? closure.driven : closure.motor) = i;
      closure.mode = leg ? 0 : chain.working_mode;
    }
  }
}

engine::Row stand(const Robot& robot, const Built& built, const Joint& q, const Pose& pose) {
  const engine::Mechanism& m = built.mechanism;
  engine::Row y{};
  if (is_mechanism(robot.mobility)) y = m.home;
  for (int i : range(m.motors)) y[i] = motor_position(robot.chain[i], q[i]);
  Real* x = y.data() + m.motors;
  if (built.layout == Layout::free) {
    const Vec3 w = log_so3(pose.R);
    copy_first(3, pose.D, x);
    copy_first(3, w, x + 3);
  } else {
    const Coordinates coordinates = to_coordinates(robot.mobility, pose);
    copy_first(m.coordinates, coordinates, x);
  }
  std::fill(y.begin() + built.turn, y.begin() + m.freedoms, -pose.theta);
  return y;
}

void stand(const Robot& robot, const Closure& closure, Built& built, engine::Position& at) {
  build(robot, Layout::ideal, built);
  at.y = stand(robot, built, closure.q(), closure.pose);
  engine::place(built.mechanism, at);
}
}  // namespace truepose
