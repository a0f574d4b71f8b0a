// The plant: true geometry under motor torques, and its encoders' readings.
#pragma once

#include <random>

#include "control/dynamics.hpp"
#include "mechanism/full.hpp"

namespace truepose {
/// State of the plant: pose and free twist. Its Robot is the true one.
struct PlantState {
  Pose pose;
  Coordinates rate{};
};

/// Derivative of the rotation vector u of R = exp(u) R₀ for the angular velocity ω (Munthe-Kaas):
/// ω - [u,ω]/2 + [u,[u,ω]]/12, sufficient for order four. Identity for other mobilities.
Coordinates tangent_rate(Mobility mobility, const Coordinates& u, const Coordinates& rate);

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
Outcome advance(const Robot& truth, const Joint& torque, double period, int steps,
                PlantState& state);

/// Computes the torques that hold a robot at a pose against its weight.
inline Outcome hold(const Robot& robot, const Pose& pose, Joint& torque) {
  return inverse_dynamics(robot, pose, Coordinates{}, Coordinates{}, torque);
}

/// Random generator of the readings' noise, reproducible by seed.
using Random = std::mt19937_64;

/// Converts exact readings to real ones: adds Gaussian noise, then quantizes.
void spoil(const Robot& truth, Random& random, Extended& q_e);

/// Readings without noise and quantization, at the robot's level. @param rest  as for ikm_full
Outcome exact_readings(const Robot& robot, const Pose& pose, Extended& q_e, Parasitic& rest);

/// Computes the encoder readings of the true robot: its geometry, offsets, gains, noise and counts.
Outcome measure(const Robot& truth, const Pose& pose, Random& random, Extended& q_e);
}  // namespace truepose
