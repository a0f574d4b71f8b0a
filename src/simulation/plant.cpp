#include "simulation/plant.hpp"

namespace truepose {
Coordinates tangent_rate(Mobility mobility, const Coordinates& u, const Coordinates& rate) {
  if (mobility != Mobility::spatial) return rate;
  const Vec3 turn(u[3], u[4], u[5]), omega(rate[3], rate[4], rate[5]);
  const Vec3 once = turn.cross(omega), corrected = omega - once / 2 + turn.cross(once) / 12;
  return {rate[0], rate[1], rate[2], corrected[0], corrected[1], corrected[2]};
}

Outcome advance(const Robot& truth, const Joint& torque, double period, int steps,
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

void spoil(const Robot& truth, Random& random, Extended& q_e) {
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

Outcome exact_readings(const Robot& robot, const Pose& pose, Extended& q_e, Parasitic& rest) {
  return robot.rod_by_rod() ? extended_full(robot, pose, q_e, &rest) : extended(robot, pose, q_e);
}

Outcome measure(const Robot& truth, const Pose& pose, Random& random, Extended& q_e) {
  Parasitic rest;
  const Outcome outcome = exact_readings(truth, pose, q_e, rest);
  if (outcome) spoil(truth, random, q_e);
  return outcome;
}
}  // namespace truepose
