// The plant: true geometry under motor torques, and its encoders' readings.
#pragma once

#include <functional>
#include <random>

#include "control/dynamics.hpp"
#include "mechanism/levels.hpp"

namespace truepose {
/// State of the plant: pose and free twist. Its Robot is the true one.
struct PlantState {
  Pose pose;
  Coordinates rate{};
};

/// Motors' elastic rotors: angles, then from n on their rates.
using Rotors = std::array<double, 2 * kMaxMotors>;

/// Torques of a closed pose, and the derivative of the rotors.
using Drive =
    std::function<Joint(const Closure&, const DynamicModel&, const Rotors& y, Rotors& dy)>;

/// Advances the plant, and its rotors, by one Runge-Kutta 4 step.
/// @return unreachable or singular where it leaves its workspace; the state is then unchanged
Outcome step(const Robot& truth, double h, PlantState& state, Rotors& y, const Drive& drive);

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
}  // namespace truepose
