// The robot for given values of ξ.
#include "mechanism/geometry.hpp"

namespace truepose {
namespace {
/// Copies members of a part to their columns of ξ, or back.
struct Exchange {
  Real* xi;
  bool to_xi;

  template <class Parameter>
  void operator()(Parameter first, Real* members, int count) const {
    Real* column = xi + int(first);
    to_xi ? std::copy_n(members, count, column) : std::copy_n(column, count, members);
  }
  template <class Parameter>
  void operator()(Parameter of, Real& member) const {
    (*this)(of, &member, 1);
  }
  template <class Parameter>
  void operator()(Parameter first, Vec3& vector) const {
    (*this)(first, vector.data(), 3);
  }
};

void exchange(const Exchange& with, Chain& chain) {
  using enum ChainParameter;
  with(base_x, chain.base);
  with(arm, chain.arm);
  with(rod, chain.rod);
  with(encoder_offset, chain.encoder_offset);
  with(encoder_gain, chain.encoder_gain);
  with(encoder_buildup, chain.encoder_buildup);
  with(anchor_x, chain.bar < 0 ? chain.pivot : chain.anchor);
  with(rod_difference, chain.rod_difference);
  with(rod_spacing, chain.rod_spacing);
  with(eccentricity_c1, chain.eccentricity.amplitude.data(), 4);
}

void exchange(const Exchange& with, Sensor& sensor) {
  using enum SensorParameter;
  with(offset, sensor.offset);
  with(gain, sensor.gain);
  with(origin_x, sensor.origin);
  with(direction_x, sensor.direction);
  with(target_x, sensor.target);
  with(normal_x, sensor.normal);
  with(eccentricity_c1, sensor.eccentricity.amplitude.data(), 4);
}

void exchange(const Exchange& with, PassiveAxis& axis) {
  with(AxisParameter::origin_x, axis.origin);
  with(AxisParameter::direction_x, axis.direction);
}

void exchange(const Exchange& with, engine::Body& body) {
  with(AxisParameter::origin_x, body.origin);
  with(AxisParameter::direction_x, body.axis);
  with(AxisParameter::zero, body.offset);
}

void exchange(const Exchange& with, engine::Closure& closure) {
  using enum ClosureParameter;
  with(closure.exchanged ? base_x : anchor_x, closure.a);
  with(closure.exchanged ? anchor_x : base_x, closure.b);
  if (closure.plane)
    with(closure.exchanged ? anchor_hinge_x : base_hinge_x, closure.normal);
  else
    with(length, closure.length);
}

/// All parts, each from its first column on.
void exchange(Robot& robot, Real* xi, bool to_xi) {
  for (int i : range(robot.chains)) exchange({xi + chain_column(i), to_xi}, robot.chain[i]);
  for (int k : range(robot.r)) exchange({xi + sensor_column(robot, k), to_xi}, robot.sensor[k]);
  engine::Mechanism& m = robot.mechanism;
  const bool described = is_mechanism(robot.mobility);
  for (int j : range(joints_of(robot))) {
    const Exchange with{xi + axis_column(robot, j), to_xi};
    described ? exchange(with, m.body[j]) : exchange(with, robot.axis[j]);
  }
  for (int i = 0; i < m.closures && described; ++i)
    exchange({xi + closure_column(robot, m.closure[i].described), to_xi}, m.closure[i]);
}
}  // namespace

Outcome drawn_parameters(const Robot& drawn, Real* xi) {
  if (!drawn.finished) return {Status::unfinished};
  std::fill_n(xi, parameter_count(drawn), 0.0);
  exchange(const_cast<Robot&>(drawn), xi, true);  // which it only reads
  for (int i : range(drawn.chains))
    if (const int bar = drawn.chain[i].bar; bar >= 0)
      xi[bar_column(drawn, bar)] = drawn.chain[i].pivot.norm();
  return {};
}

Outcome set_parameters(const Robot& drawn, const Real* xi, Robot& robot) {
  if (!drawn.finished || !robot.finished) return {Status::unfinished};
  exchange(robot, const_cast<Real*>(xi), false);
  for (int i : range(drawn.chains)) {
    const Chain& from = drawn.chain[i];
    Chain& chain = robot.chain[i];
    const auto turn_of = [&](ChainParameter p) { return xi[chain_column(i) + int(p)]; };
    // Yaw adds to α: it turns e and u about z. Tilt then turns u about e.
    const Mat3 yaw = rotation_z(turn_of(ChainParameter::yaw));
    chain.zero = yaw * from.zero;
    const Mat3 turn = exp_so3(turn_of(ChainParameter::tilt) * chain.zero) * yaw;
    chain.axis = turn * from.axis;
    chain.pair_axis = turn * from.pair_drawn;
    if (chain.bar >= 0) chain.pivot = xi[bar_column(drawn, chain.bar)] * from.pivot.normalized();
  }
  for (int k : range(drawn.bodies))
    if (const int bar = drawn.body[k].bar; bar >= 0 && !is_mechanism(drawn.mobility))
      robot.body[k].pivot = xi[bar_column(drawn, bar)] * drawn.body[k].pivot.normalized();
  const auto unit = [](Vec3& direction) { direction = direction.normalized(); };
  for (int k : range(drawn.r)) unit(robot.sensor[k].direction), unit(robot.sensor[k].normal);
  for (int j : range(passive_axes(drawn.mobility))) unit(robot.axis[j].direction);
  for (int b : range(robot.mechanism.bodies)) unit(robot.mechanism.body[b].axis);
  for (int i : range(robot.mechanism.closures)) unit(robot.mechanism.closure[i].normal);
  note_encoders(robot);
  return {};
}
}  // namespace truepose
