// Field-by-field conversion between the C interface's structs and the core's.
#pragma once

#include "truepose/core.hpp"
#include "truepose/truepose.h"

namespace truepose::c {

/// Calls f(name, field of the C struct, field of the core's) for every number and vector.
template <class C, class Core, class F>
void chain_fields(C& c, Core& core, F&& f) {
  f("base", c.base, core.base);
  f("axis", c.axis, core.axis);
  f("zero", c.zero, core.zero);
  f("pivot", c.pivot, core.pivot);
  f("anchor", c.anchor, core.anchor);
  f("pair_axis", c.pair_axis, core.pair_axis);
  f("pair_drawn", c.pair_drawn, core.pair_drawn);
  f("arm", c.arm, core.arm);
  f("rod", c.rod, core.rod);
  f("rod_spacing", c.rod_spacing, core.rod_spacing);
  f("rod_difference", c.rod_difference, core.rod_difference);
  f("encoder_offset", c.encoder_offset, core.encoder_offset);
  f("encoder_gain", c.encoder_gain, core.encoder_gain);
  f("encoder_buildup", c.encoder_buildup, core.encoder_buildup);
  f("gear", c.gear, core.eccentricity.gear);
  f("eccentricity", c.eccentricity, core.eccentricity.amplitude);
  f("encoder_step", c.encoder_step, core.encoder_step);
  f("encoder_noise", c.encoder_noise, core.encoder_noise);
  f("low", c.low, core.low);
  f("high", c.high, core.high);
  f("torque_limit", c.torque_limit, core.torque_limit);
  f("drive_inertia", c.drive_inertia, core.drive_inertia);
  f("arm_mass", c.arm_mass, core.arm_mass);
  f("rod_mass", c.rod_mass, core.rod_mass);
  f("viscous", c.viscous, core.viscous);
  f("coulomb", c.coulomb, core.coulomb);
}
template <class C, class Core, class F>
void sensor_fields(C& c, Core& core, F&& f) {
  f("gain", c.gain, core.gain);
  f("offset", c.offset, core.offset);
  f("gear", c.gear, core.eccentricity.gear);
  f("eccentricity", c.eccentricity, core.eccentricity.amplitude);
  f("step", c.step, core.step);
  f("noise", c.noise, core.noise);
  f("weight", c.weight, core.weight);
  f("origin", c.origin, core.origin);
  f("direction", c.direction, core.direction);
  f("target", c.target, core.target);
  f("normal", c.normal, core.normal);
}
template <class C, class Core, class F>
void body_fields(C& c, Core& core, F&& f) {
  f("mass", c.mass, core.mass);
  f("pivot", c.pivot, core.pivot);
  f("anchor", c.anchor, core.anchor);
  f("inertia", c.inertia, core.inertia);  // symmetric: the same by rows and by columns
}

template <class C, class Core, class F>
void axis_fields(C& c, Core& core, F&& f) {
  f("origin", c.origin, core.origin);
  f("direction", c.direction, core.direction);
  f("low", c.low, core.low);
  f("high", c.high, core.high);
}

template <class C, class Core, class F>
void control_fields(C& c, Core& core, F&& f) {
  f("period", c.period, core.period);
  f("velocity_bandwidth", c.velocity_bandwidth, core.velocity_bandwidth);
  f("damped_below", c.damped_below, core.damped_below);
  f("lead_out", c.lead_out, core.lead_out);
  f("kp", c.kp, core.kp);
  f("kd", c.kd, core.kd);
  f("ki", c.ki, core.ki);
}
/// @param stops  of a fault-tolerant controller, beside its fault monitor
template <class C, class FaultMonitor, class Stops, class F>
void watch_fields(C& c, FaultMonitor& watch, Stops& stops, F&& f) {
  f("period", c.period, watch.period);
  f("false_alarm", c.false_alarm, watch.false_alarm);
  f("replaceable", c.replaceable, watch.replaceable);
  f("correlation", c.correlation, watch.correlation);
  f("stop", c.stop, stops.stop);
  f("stop_lost", c.stop_lost, stops.stop_lost);
  f("held", c.held, stops.held);
  f("fastest", c.fastest, watch.fastest);
  f("moved", c.moved, watch.moved);
  f("kp", c.kp, watch.kp);
  f("kd", c.kd, watch.kd);
  f("rests", c.rests, watch.rests);
  f("shaken", c.shaken, watch.shaken);
  f("low", c.low, watch.low);
  f("high", c.high, watch.high);
}

/// Copies a number or a vector, to the core or from it.
template <bool ToCore>
struct Copy {
  template <class C, class Core>
  void operator()(const char*, C& c, Core& core) const {
    if constexpr (ToCore)
      core = c;
    else
      c = core;
  }
  template <class C, class Core, std::size_t N>
  void operator()(const char*, C (&c)[N], Core& core) const {
    for (std::size_t k = 0; k < N; ++k) (*this)("", c[k], entry(core, k));
  }

 private:
  template <class Core>
  static auto& entry(Core& core, std::size_t k) {
    if constexpr (requires { core.number; })
      return core.number[k];
    else
      return core[k];
  }
};

/// Checks that all numbers of a part are finite.
struct Finite {
  bool all = true;
  void operator()(const char*, const truepose_real& number, const auto&) {
    all = all && std::isfinite(number);
  }
  template <std::size_t N>
  void operator()(const char*, const truepose_real (&numbers)[N], const auto&) {
    for (const truepose_real& number : numbers) all = all && std::isfinite(number);
  }
};

/// Writes the description of a finished robot, or of a nominal one.
inline void describe(const Robot& robot, truepose_description& of) {
  constexpr Copy<false> copy;
  of = truepose_description{};
  of.abi = TRUEPOSE_ABI;
  of.size = sizeof of;
  of.mobility = static_cast<std::int32_t>(robot.mobility);
  of.chains = robot.chains;
  of.motors = robot.motors;
  of.sensors = robot.r;
  of.bodies = robot.bodies;
  of.bar_joint = static_cast<std::int32_t>(robot.bar_joint);
  of.level = static_cast<std::int32_t>(robot.level);
  copy("gravity", of.gravity, robot.gravity);
  copy("home", of.home, robot.home);
  for (int i = 0; i < robot.chains; ++i) {
    truepose_chain& c = of.chain[i];
    const Chain& chain = robot.chain[i];
    c.actuator = static_cast<std::int32_t>(chain.actuator);
    c.working_mode = chain.working_mode;
    c.bar = chain.bar;
    chain_fields(c, chain, copy);
  }
  for (int k = 0; k < robot.r; ++k) {
    truepose_sensor& c = of.sensor[k];
    const Sensor& sensor = robot.sensor[k];
    c.kind = static_cast<std::int32_t>(sensor.kind);
    c.chain = sensor.chain;
    c.at_nacelle = sensor.at_nacelle;
    c.rod = sensor.rod;
    c.bar = sensor.bar;
    c.axis = sensor.axis;
    sensor_fields(c, sensor, copy);
  }
  for (int k = 0; k < robot.bodies; ++k) {
    of.body[k].bar = robot.body[k].bar;
    body_fields(of.body[k], robot.body[k], copy);
  }
  for (int j = 0; j < passive_axes(robot.mobility); ++j)
    axis_fields(of.axis[j], robot.axis[j], copy);
}

inline void describe(const ControlSettings& settings, truepose_control_settings& of) {
  of = truepose_control_settings{};
  of.law = static_cast<std::int32_t>(settings.law);
  of.gains = static_cast<std::int32_t>(settings.gains);
  of.feed_forward = static_cast<std::int32_t>(settings.feed_forward);
  of.sigma_scale = settings.sigma_scale;
  control_fields(of, settings, Copy<false>{});
}
inline void describe(const FaultTolerantSettings& settings, truepose_fault_monitor_settings& of) {
  of = truepose_fault_monitor_settings{};
  of.refresh = settings.watch.refresh;
  of.coast = settings.watch.coast;
  of.decide = settings.watch.decide;
  of.spikes = settings.watch.spikes;
  of.within = settings.watch.within;
  watch_fields(of, settings.watch, settings, Copy<false>{});
}

/// Implements truepose_load(); returns the finished robot.
Outcome load(const truepose_description& of, Robot& robot);

}  // namespace truepose::c
