// The plant: true geometry under motor torques, and its encoders' readings.
#include "simulation/plant.hpp"

namespace truepose {
namespace {
/// Derivative of the rotation vector u of R = exp(u) R₀ for the angular velocity ω (Munthe-Kaas):
/// ω - [u,ω]/2 + [u,[u,ω]]/12, sufficient for order four. Identity for other mobilities.
Coordinates tangent_rate(Mobility mobility, const Coordinates& u, const Coordinates& rate) {
  if (mobility != Mobility::spatial) return rate;
  const Vec3 turn(u[3], u[4], u[5]), omega(rate[3], rate[4], rate[5]);
  const Vec3 once = turn.cross(omega), corrected = omega - once / 2 + turn.cross(once) / 12;
  return {rate[0], rate[1], rate[2], corrected[0], corrected[1], corrected[2]};
}

/// start + scale · slope, number by number.
template <std::size_t N>
std::array<double, N> along(std::array<double, N> start, double scale,
                            const std::array<double, N>& slope) {
  for (std::size_t i = 0; i < N; ++i) start[i] += scale * slope[i];
  return start;
}
}  // namespace

Outcome step(const Robot& truth, double h, PlantState& state, Rotors& y, const Drive& drive) {
  constexpr std::array<double, 4> node{0, 0.5, 0.5, 1}, weight{1. / 6, 1. / 3, 1. / 3, 1. / 6};
  Coordinates motion{}, change{}, velocity{}, acceleration{};
  Rotors dy{}, whole{};
  for (int stage : range(4)) {
    const Coordinates u = along(Coordinates{}, h * node[stage], velocity);
    const Coordinates rate = along(state.rate, h * node[stage], acceleration);
    const Rotors at = along(y, h * node[stage], dy);
    const Pose pose = stage == 0 ? state.pose : moved(truth.mobility, state.pose, u);
    velocity = tangent_rate(truth.mobility, u, rate);
    const Outcome outcome = forward_dynamics_under(
        truth, pose, rate,
        [&](const Closure& closure, const DynamicModel& model) {
          return drive(closure, model, at, dy);
        },
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

Outcome advance(const Robot& truth, const Joint& torque, double period, int steps,
                PlantState& state) {
  Rotors rigid{};
  const Drive drive = [&](const auto&, const auto&, const auto&, auto&) { return torque; };
  for (int s = 0; s < steps; ++s) {
    const Outcome outcome = step(truth, period / steps, state, rigid, drive);
    if (!outcome) return outcome;
  }
  return {};
}

void spoil(const Robot& truth, Random& random, Extended& q_e) {
  const int n = truth.motors;
  const auto spoilt = [&](double value, double sigma, double step) {
    if (sigma > 0) value += std::normal_distribution<double>(0, sigma)(random);
    return quantized(value, step);
  };
  for (int i : range(n))
    q_e[i] = spoilt(q_e[i], truth.chain[i].encoder_noise, truth.chain[i].encoder_step);
  for (int k : range(truth.r))
    q_e[n + k] = spoilt(q_e[n + k], truth.sensor[k].noise, truth.sensor[k].step);
}
}  // namespace truepose
