// Field-by-field conversion between the C interface's structs and the core's.
#pragma once

#include "c/each.hpp"
#include "control/fault_tolerant_control.hpp"
#include "control/safe_control.hpp"
#include "control/start_test.hpp"
#include "estimation/estimate.hpp"
#include "mechanism/geometry.hpp"
#include "truepose/truepose.h"

namespace truepose::c {
template <class T, class Core>
concept Like = std::is_same_v<std::remove_const_t<T>, Core>;

// f(name, member of the C struct, of the core's) for members of the same names.
#define TRUEPOSE_VISIT(c, core, ...) TRUEPOSE_EACH(TRUEPOSE_VISIT_ONE, c, core, __VA_ARGS__)
#define TRUEPOSE_VISIT_ONE(c, core, member) f(#member, c.member, core.member);

/// Calls f(name, field of the C struct, field of the core's) for every enum, index and number.
void fields(auto& c, Like<Chain> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, actuator, working_mode, bar, base, axis, zero, pivot, anchor, pair_axis,
                 pair_drawn, arm, rod, rod_spacing, rod_difference, encoder_offset, encoder_gain,
                 encoder_buildup)
  f("gear", c.gear, core.eccentricity.gear);
  f("eccentricity", c.eccentricity, core.eccentricity.amplitude);
  TRUEPOSE_VISIT(c, core, encoder_step, encoder_noise, low, high, torque_limit, drive_inertia,
                 arm_mass, rod_mass, viscous, coulomb)
}
void fields(auto& c, Like<Sensor> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, kind, chain, at_nacelle, rod, bar, axis, gain, offset)
  f("gear", c.gear, core.eccentricity.gear);
  f("eccentricity", c.eccentricity, core.eccentricity.amplitude);
  TRUEPOSE_VISIT(c, core, step, noise, weight, origin, direction, target, normal)
}
void fields(auto& c, Like<Body> auto& core, auto&& f) {  // inertia: by rows and columns the same
  TRUEPOSE_VISIT(c, core, bar, mass, pivot, anchor, inertia)
}
void fields(auto& c, Like<PassiveAxis> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, origin, direction, low, high)
}
/// The robot itself, without its parts.
void fields(auto& c, Like<Robot> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, mobility, chains, motors)
  f("sensors", c.sensors, core.r);
  TRUEPOSE_VISIT(c, core, bodies, bar_joint, level, gravity, home)
}
void fields(auto& c, Like<ControlSettings> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, law, gains, feed_forward, sigma_scale, period, velocity_bandwidth,
                 damped_below, lead_out, kp, kd, ki)
}
void fields(auto& c, Like<FaultTolerantSettings> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core.monitor, refresh, coast, decide, spikes, within, period, false_alarm,
                 replaceable, correlation)
  TRUEPOSE_VISIT(c, core, stop, stop_lost, held)
  TRUEPOSE_VISIT(c, core.monitor, fastest, moved, kp, kd, rests, shaken, low, high, growth, memory)
}
void fields(auto& c, Like<MomentumSettings> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, carry, period, bandwidth, alarm, share, named, kept, window, over, sigma,
                 give)
}
void fields(auto& c, Like<MultirateSettings> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, stamped, every, age, period, sensitivity)
}
void fields(auto& c, Like<SafetyLimits> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, window, age, counter_bits, period, saturation, clipped, missing, held,
                 stop, brake, standstill)
  TRUEPOSE_VISIT(c, core, torque, slew, tracking, deviation, speed, count, still, kp, kd, rests,
                 low, high, box_low, box_high)
}
void fields(auto& c, Like<StartSettings> auto& core, auto&& f) {
  TRUEPOSE_VISIT(c, core, pairs, motion, radius, pulse, settle, brake_opens, inertia, weight,
                 false_alarm, friction)
}

/// Calls f(part of the C description, part of the core's) for every part in use.
void parts(auto& c, auto& core, auto&& f) {
  for (int i = 0; i < core.chains; ++i) f(c.chain[i], core.chain[i]);
  for (int k = 0; k < core.r; ++k) f(c.sensor[k], core.sensor[k]);
  for (int k = 0; k < core.bodies; ++k) f(c.body[k], core.body[k]);
  for (int j = 0; j < passive_axes(core.mobility); ++j) f(c.axis[j], core.axis[j]);
}

/// Copies a number, an enum or a vector, to the core or from it.
template <bool ToCore>
struct Copy {
  template <class C, class Core>
  void operator()(const char*, C& c, Core& core) const {
    if constexpr (ToCore)
      core = static_cast<Core>(c);
    else
      c = static_cast<C>(core);
  }
  template <class C, class Core, std::size_t N>
  void operator()(const char*, C (&c)[N], Core& core) const {
    for (std::size_t k = 0; k < N; ++k) (*this)("", c[k], core.data()[k]);
  }
};

/// Whether all numbers of a part are finite.
bool finite(const auto& c, const auto& core) {
  bool all = true;
  fields(c, core, [&]<class C>(const char*, const C& numbers, const auto&) {
    if constexpr (std::is_array_v<C>)
      for (const truepose_real number : numbers) all = all && std::isfinite(number);
    else
      all = all && std::isfinite(static_cast<truepose_real>(numbers));
  });
  return all;
}

/// Writes settings, or a robot, finished or nominal, as their C struct.
template <class C>
void describe(const auto& core, C& of) {
  of = C{};
  fields(of, core, Copy<false>{});
  of.size = sizeof of;
  if constexpr (std::is_same_v<C, truepose_description>) {
    of.abi = TRUEPOSE_ABI;
    parts(of, core, [](auto& c, const auto& part) { fields(c, part, Copy<false>{}); });
  }
}

/// Implements truepose_load(); returns the finished robot.
Outcome load(const truepose_description& of, Robot& robot);
}  // namespace truepose::c
