// The robot for given values of ξ.
#include "mechanism/geometry.hpp"

namespace truepose {
Outcome drawn_parameters(const Robot& drawn, Real* xi) {
  if (!drawn.finished) return {Status::unfinished, -1};
  std::fill_n(xi, parameter_count(drawn), 0.0);
  const auto enter = [](Real* at, const Vec3& vector) { std::copy_n(vector.data(), 3, at); };
  for (int i = 0; i < drawn.chains; ++i) {
    const Chain& chain = drawn.chain[i];
    Real* of = xi + chain_column(i);
    const auto at = [&](ChainParameter p) { return of + static_cast<int>(p); };
    enter(at(ChainParameter::base_x), chain.base);
    *at(ChainParameter::arm) = chain.arm;
    *at(ChainParameter::rod) = chain.rod;
    *at(ChainParameter::encoder_offset) = chain.encoder_offset;
    *at(ChainParameter::encoder_gain) = chain.encoder_gain;
    *at(ChainParameter::encoder_buildup) = chain.encoder_buildup;
    enter(at(ChainParameter::anchor_x), chain.bar < 0 ? chain.pivot : chain.anchor);
    *at(ChainParameter::rod_difference) = chain.rod_difference;
    *at(ChainParameter::rod_spacing) = chain.rod_spacing;
    std::copy_n(chain.eccentricity.amplitude.data(), 4, at(ChainParameter::eccentricity_c1));
    if (chain.bar >= 0) xi[bar_column(drawn, chain.bar)] = chain.pivot.norm();
  }
  for (int k = 0; k < drawn.r; ++k) {
    const Sensor& sensor = drawn.sensor[k];
    Real* of = xi + sensor_column(drawn, k);
    const auto at = [&](SensorParameter p) { return of + static_cast<int>(p); };
    *at(SensorParameter::offset) = sensor.offset;
    *at(SensorParameter::gain) = sensor.gain;
    enter(at(SensorParameter::origin_x), sensor.origin);
    enter(at(SensorParameter::direction_x), sensor.direction);
    enter(at(SensorParameter::target_x), sensor.target);
    enter(at(SensorParameter::normal_x), sensor.normal);
    std::copy_n(sensor.eccentricity.amplitude.data(), 4, at(SensorParameter::eccentricity_c1));
  }
  const bool described = is_mechanism(drawn.mobility);
  for (int j = 0; j < joints_of(drawn); ++j) {
    Real* of = xi + axis_column(drawn, j);
    const engine::Body& body = drawn.mechanism.body[j];
    const PassiveAxis& axis = drawn.axis[described ? 0 : j];
    enter(of + static_cast<int>(AxisParameter::origin_x), described ? body.origin : axis.origin);
    enter(of + static_cast<int>(AxisParameter::direction_x),
          described ? body.axis : axis.direction);
    of[static_cast<int>(AxisParameter::zero)] = described ? body.offset : 0;
  }
  for (int i = 0; i < drawn.mechanism.closures && described; ++i) {
    const engine::Closure& of = drawn.mechanism.closure[i];
    Real* to = xi + closure_column(drawn, of.joint);
    const auto at = [&](ClosureParameter p) { return to + static_cast<int>(p); };
    using enum ClosureParameter;
    enter(at(of.exchanged ? base_x : anchor_x), of.a);
    enter(at(of.exchanged ? anchor_x : base_x), of.b);
    if (of.plane)
      enter(at(of.exchanged ? anchor_hinge_x : base_hinge_x), of.normal);
    else
      *at(length) = of.length;
  }
  return {};
}

Outcome set_parameters(const Robot& drawn, const Real* xi, Robot& robot) {
  if (!drawn.finished || !robot.finished) return {Status::unfinished, -1};
  const auto vector = [](const Real* at) { return Vec3(at[0], at[1], at[2]); };
  for (int i = 0; i < drawn.chains; ++i) {
    const Chain& from = drawn.chain[i];
    Chain& chain = robot.chain[i];
    const Real* of = xi + chain_column(i);
    const auto at = [&](ChainParameter p) { return of + static_cast<int>(p); };
    chain.base = vector(at(ChainParameter::base_x));
    chain.arm = *at(ChainParameter::arm);
    chain.rod = *at(ChainParameter::rod);
    chain.encoder_offset = *at(ChainParameter::encoder_offset);
    chain.encoder_gain = *at(ChainParameter::encoder_gain);
    chain.encoder_buildup = *at(ChainParameter::encoder_buildup);
    // Yaw adds to α: it turns e and u about z. Tilt then turns u about e.
    const Mat3 yaw = rotation_z(*at(ChainParameter::yaw));
    chain.zero = yaw * from.zero;
    const Mat3 turn = exp_so3(*at(ChainParameter::tilt) * chain.zero) * yaw;
    chain.axis = turn * from.axis;
    chain.pair_axis = turn * from.pair_drawn;
    chain.rod_difference = *at(ChainParameter::rod_difference);
    chain.rod_spacing = *at(ChainParameter::rod_spacing);
    std::copy_n(at(ChainParameter::eccentricity_c1), 4, chain.eccentricity.amplitude.begin());
    const Vec3 anchor = vector(at(ChainParameter::anchor_x));
    if (chain.bar < 0) {
      chain.pivot = anchor;
    } else {
      chain.pivot = xi[bar_column(drawn, chain.bar)] * from.pivot.normalized();
      chain.anchor = anchor;
    }
  }
  for (int k = 0; k < drawn.bodies; ++k)
    if (const int bar = drawn.body[k].bar; bar >= 0)
      robot.body[k].pivot = xi[bar_column(drawn, bar)] * drawn.body[k].pivot.normalized();
  for (int k = 0; k < drawn.r; ++k) {
    Sensor& sensor = robot.sensor[k];
    const Real* of = xi + sensor_column(drawn, k);
    const auto at = [&](SensorParameter p) { return of + static_cast<int>(p); };
    sensor.offset = *at(SensorParameter::offset);
    sensor.gain = *at(SensorParameter::gain);
    sensor.origin = vector(at(SensorParameter::origin_x));
    sensor.target = vector(at(SensorParameter::target_x));
    sensor.direction = vector(at(SensorParameter::direction_x)).normalized();
    sensor.normal = vector(at(SensorParameter::normal_x)).normalized();
    std::copy_n(at(SensorParameter::eccentricity_c1), 4, sensor.eccentricity.amplitude.begin());
  }
  const bool described = is_mechanism(drawn.mobility);
  for (int j = 0; j < joints_of(drawn); ++j) {
    const Real* of = xi + axis_column(drawn, j);
    const Vec3 origin = vector(of + static_cast<int>(AxisParameter::origin_x));
    const Vec3 direction = vector(of + static_cast<int>(AxisParameter::direction_x)).normalized();
    if (described) {
      engine::Body& body = robot.mechanism.body[j];
      body.origin = origin, body.axis = direction;
      body.offset = of[static_cast<int>(AxisParameter::zero)];
    } else {
      robot.axis[j].origin = origin, robot.axis[j].direction = direction;
    }
  }
  for (int i = 0; i < drawn.mechanism.closures && described; ++i) {
    engine::Closure& closure = robot.mechanism.closure[i];
    const Real* of = xi + closure_column(drawn, closure.joint);
    const auto at = [&](ClosureParameter p) { return of + static_cast<int>(p); };
    using enum ClosureParameter;
    closure.a = vector(at(closure.exchanged ? base_x : anchor_x));
    closure.b = vector(at(closure.exchanged ? anchor_x : base_x));
    if (closure.plane)
      closure.normal = vector(at(closure.exchanged ? anchor_hinge_x : base_hinge_x)).normalized();
    else
      closure.length = *at(length);
  }
  note_encoders(robot);
  return {};
}
}  // namespace truepose
