// What does the real robot do? The true geometry under motor torques, and what its encoders read.
#pragma once

#include <random>

#include "truepose/dynamics.hpp"
#include "truepose/rkm.hpp"

namespace truepose {

/// State of the plant: pose and free twist. Its Robot is the *true* one.
struct PlantState {
  Pose pose;
  Joint rate{};
};

/// Derivative of the rotation vector u of R = exp(u) R₀ for the angular velocity ω (Munthe-Kaas):
/// ω - [u,ω]/2 + [u,[u,ω]]/12, enough for order four. Identity for every other mobility.
template <Mobility K>
inline Joint tangent_rate(const Joint& u, const Joint& rate) {
  if constexpr (K != Mobility::spatial) {
    return rate;
  } else {
    const Vec3 turn(u[3], u[4], u[5]), omega(rate[3], rate[4], rate[5]);
    const Vec3 once = turn.cross(omega), corrected = omega - once / 2 + turn.cross(once) / 12;
    return {rate[0], rate[1], rate[2], corrected[0], corrected[1], corrected[2]};
  }
}

/// Advances the plant by `period` under constant torque, in `steps` steps of Runge-Kutta 4.
/// @return unreachable or singular when it leaves its workspace; the state is then the last good
/// one
template <Mobility K>
inline Outcome advance(const Robot& truth, const Joint& torque, double period, int steps,
                       PlantState& state) {
  constexpr int n = kDof<K>;
  const double h = period / steps;
  const auto along = [](const Joint& start, double scale, const Joint& slope) {
    Joint result{};
    for (int i = 0; i < n; ++i) result[i] = start[i] + scale * slope[i];
    return result;
  };
  for (int s = 0; s < steps; ++s) {
    constexpr std::array<double, 4> node{0, 0.5, 0.5, 1}, weight{1. / 6, 1. / 3, 1. / 3, 1. / 6};
    Joint motion{}, change{}, velocity{}, acceleration{};
    for (int stage = 0; stage < 4; ++stage) {
      const Joint u = along(Joint{}, h * node[stage], velocity);
      const Joint rate = along(state.rate, h * node[stage], acceleration);
      const Pose pose = stage == 0 ? state.pose : moved<K>(state.pose, u);
      velocity = tangent_rate<K>(u, rate);
      const Outcome outcome = forward_dynamics<K>(truth, pose, rate, torque, acceleration);
      if (!outcome) return outcome;
      motion = along(motion, h * weight[stage], velocity);
      change = along(change, h * weight[stage], acceleration);
    }
    state.pose = moved<K>(state.pose, motion);
    state.rate = along(state.rate, 1, change);
  }
  return {};
}

/// Where the noise of readings comes from: the same seed gives the same noise.
using Random = std::mt19937_64;

/// Exact readings become those of real encoders: Gaussian noise, then counts.
inline void spoil(const Robot& truth, Random& random, Extended& q_e) {
  const int n = dof(truth.mobility);
  const auto spoilt = [&](double value, double sigma, double step) {
    if (sigma > 0) value += std::normal_distribution<double>(0, sigma)(random);
    return quantised(value, step);
  };
  for (int i = 0; i < n; ++i)
    q_e[i] = spoilt(q_e[i], truth.chain[i].encoder_noise, truth.chain[i].encoder_step);
  for (int k = 0; k < truth.r; ++k)
    q_e[n + k] = spoilt(q_e[n + k], truth.sensor[k].noise, truth.sensor[k].step);
}

/// What the encoders of the real robot read: its own geometry, offsets, gains, noise and counts.
template <Mobility K>
inline Outcome measure(const Robot& truth, const Pose& pose, Random& random, Extended& q_e) {
  const Outcome outcome = extended<K>(truth, pose, q_e);
  if (outcome) spoil(truth, random, q_e);
  return outcome;
}

}  // namespace truepose
