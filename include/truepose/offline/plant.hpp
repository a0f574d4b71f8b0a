// The plant: true geometry under motor torques, and its encoders' readings.
#pragma once

#include <random>

#include "truepose/control/dynamics.hpp"
#include "truepose/full/rkm.hpp"

namespace truepose {
/// State of the plant: pose and free twist. Its Robot is the true one.
struct PlantState {
  Pose pose;
  Coordinates rate{};
};

/// Derivative of the rotation vector u of R = exp(u) R₀ for the angular velocity ω (Munthe-Kaas):
/// ω - [u,ω]/2 + [u,[u,ω]]/12, sufficient for order four. Identity for other mobilities.
inline Coordinates tangent_rate(Mobility mobility, const Coordinates& u, const Coordinates& rate) {
  if (mobility != Mobility::spatial) return rate;
    const Vec3 turn(u[3], u[4], u[5]), omega(rate[3], rate[4], rate[5]);
    const Vec3 once = turn.cross(omega), corrected = omega - once / 2 + turn.cross(once) / 12;
    return {rate[0], rate[1], rate[2], corrected[0], corrected[1], corrected[2]};
}

/// Advances the plant, and M values y driven by its motors, by one Runge-Kutta 4 step.
/// @param drive  drive(closure, model, y, dy) -> Joint: torques, and the derivative of y
/// @return unreachable or singular where it leaves its workspace; the state is then unchanged
template <std::size_t M, class Drive>
inline Outcome step(const Robot& truth, double h, PlantState& state, std::array<double, M>& y,
                    Drive&& drive) {
  const auto along = [](const auto& start, double scale, const auto& slope) {
    auto result = start;
    for (std::size_t i = 0; i < result.size(); ++i) result[i] += scale * slope[i];
    return result;
  };
  constexpr std::array<double, 4> node{0, 0.5, 0.5, 1}, weight{1. / 6, 1. / 3, 1. / 3, 1. / 6};
  Coordinates motion{}, change{}, velocity{}, acceleration{};
  std::array<double, M> dy{}, whole{};
  for (int stage = 0; stage < 4; ++stage) {
    const Coordinates u = along(Coordinates{}, h * node[stage], velocity);
    const Coordinates rate = along(state.rate, h * node[stage], acceleration);
    const std::array<double, M> at = along(y, h * node[stage], dy);
    const Pose pose = stage == 0 ? state.pose : moved(truth.mobility, state.pose, u);
    velocity = tangent_rate(truth.mobility, u, rate);
    const Outcome outcome = forward_dynamics_under(
        truth, pose, rate,
        [&](const auto& closure, const auto& model) { return drive(closure, model, at, dy); },
        acceleration);
    if (!outcome) return outcome;
    motion = along(motion, h * weight[stage], velocity);
    change = along(change, h * weight[stage], acceleration);
    whole = along(whole, h * weight[stage], dy);
  }
  state.pose = moved(truth.mobility, state.pose, motion);
  state.rate = along(state.rate, 1, change);
  y = along(y, 1, whole);
  return {};
}

/// Advances the plant by `period` under constant torque, in `steps` steps.
/// @return unreachable or singular outside its workspace; the state is then the last valid one
inline Outcome advance(const Robot& truth, const Joint& torque, double period, int steps,
                       PlantState& state) {
  std::array<double, 0> nothing;
  for (int s = 0; s < steps; ++s) {
    const Outcome outcome =
        step(truth, period / steps, state, nothing,
                       [&](const auto&, const auto&, const auto&, auto&) { return torque; });
    if (!outcome) return outcome;
  }
  return {};
}

/// Computes the torques that hold a robot at a pose against its weight.
inline Outcome hold(const Robot& robot, const Pose& pose, Joint& torque) {
  return inverse_dynamics(robot, pose, Coordinates{}, Coordinates{}, torque);
}

/// Random generator of the readings' noise, reproducible by seed.
using Random = std::mt19937_64;

/// Converts exact readings to real ones: adds Gaussian noise, then quantizes.
inline void spoil(const Robot& truth, Random& random, Extended& q_e) {
  const int n = dof(truth.mobility);
  const auto spoilt = [&](double value, double sigma, double step) {
    if (sigma > 0) value += std::normal_distribution<double>(0, sigma)(random);
    return quantized(value, step);
  };
  for (int i = 0; i < n; ++i)
    q_e[i] = spoilt(q_e[i], truth.chain[i].encoder_noise, truth.chain[i].encoder_step);
  for (int k = 0; k < truth.r; ++k)
    q_e[n + k] = spoilt(q_e[n + k], truth.sensor[k].noise, truth.sensor[k].step);
}

/// Readings without noise and quantization, at the robot's level. @param rest  as for ikm_full
inline Outcome exact_readings(const Robot& robot, const Pose& pose, Extended& q_e,
                              Parasitic& rest) {
  if (robot.rod_by_rod()) {
    FullClosure closure;
    std::array<FullRow, kMaxSensors> rows;
    return extended_full(robot, pose, q_e, closure, rows, &rest);
  }
  return extended(robot, pose, q_e);
}

/// Computes the encoder readings of the true robot: its geometry, offsets, gains, noise and counts.
inline Outcome measure(const Robot& truth, const Pose& pose, Random& random, Extended& q_e) {
  Parasitic rest;
  const Outcome outcome = exact_readings(truth, pose, q_e, rest);
  if (outcome) spoil(truth, random, q_e);
  return outcome;
}
}  // namespace truepose
