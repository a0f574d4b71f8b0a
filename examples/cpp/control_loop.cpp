// A control loop at 1 kHz: readings and a setpoint in, torques out.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

#include "h4.h"  // truepose export c h4 -o h4.h
#include "truepose/truepose.hpp"

using namespace truepose;
using Clock = std::chrono::steady_clock;

namespace {

constexpr double kPeriod = 1e-3, kFrequency = 120;  // s, rad/s

/// Stands for the machine: each motor turns a constant inertia; encoders read the geometry as
/// built.
struct Machine {
  Model model;
  Joint q{}, rate{}, inertia{};
  Coordinates x{};

  bool read(Extended& q_e) { return model.fkm(q, x) && model.readings(x, q_e); }
  void drive(const Joint& torque) {
    for (int i = 0; i < model.freedoms(); ++i) {
      rate[i] += kPeriod * torque[i] / inertia[i];
      q[i] += kPeriod * rate[i];
    }
  }
};

/// Setpoint at time t of a straight move by the paper's quintic time law.
truepose_setpoint quintic(const Coordinates& from, const Coordinates& to, double T, double t) {
  const double u = std::min(t / T, 1.0), v = 1 - u;
  const double s = u * u * u * (10 + u * (6 * u - 15));
  const double rate = 30 * u * u * v * v / T, acceleration = 60 * u * v * (1 - 2 * u) / (T * T);
  truepose_setpoint setpoint{};
  for (std::size_t i = 0; i < from.size(); ++i) {
    setpoint.x[i] = from[i] + s * (to[i] - from[i]);
    setpoint.rate[i] = rate * (to[i] - from[i]);
    setpoint.acceleration[i] = acceleration * (to[i] - from[i]);
  }
  return setpoint;
}

}  // namespace

int main() {
  Model nominal;
  Machine machine;
  truepose_description built = h4;
  built.chain[2].rod += 0.003;  // one rod 3 mm too long
  if (!nominal.load(h4) || !machine.model.load(built)) return 1;

  const Coordinates from{-0.05, 0, -0.42, 0.2}, to{0.05, 0.05, -0.40, -0.2};
  truepose_control_settings settings = h4_control;  // fixed before the loop starts
  settings.feed_forward = settings.gains = 0;  // the stand-in has no coupled inertia, no weight
  if (!outcome_of(truepose_place_poles(nominal.c(), from.data(), kFrequency, 0.9, &settings)))
    return 1;
  Controller controller;
  if (!controller.begin(settings) || !nominal.ikm(from, machine.q)) return 1;
  for (int i = 0; i < nominal.freedoms(); ++i)
    machine.inertia[i] = settings.kp[i] / (kFrequency * kFrequency);
  machine.x = from;

  std::chrono::nanoseconds longest{0};
  auto next = Clock::now();
  for (int cycle = 0; cycle < 400; ++cycle) {  // 0.2 s of move, 0.2 s at the end
    std::this_thread::sleep_until(next += std::chrono::milliseconds(1));
    Extended q_e{};
    if (!machine.read(q_e)) return 1;  // on a real machine: the drives' counts

    const auto start = Clock::now();
    Joint torque{};
    const Outcome outcome =
        controller.step(nominal, quintic(from, to, 0.2, cycle * kPeriod), q_e, torque);
    longest = std::max(longest, std::chrono::nanoseconds(Clock::now() - start));
    if (!outcome) std::printf("cycle %d: %s, torque held\n", cycle, describe(outcome.status));

    machine.drive(torque);
  }

  const Coordinates& x = machine.x;
  std::printf("at x - x_d: %.3f %.3f %.3f mm, %.4f rad\n", 1e3 * (x[0] - to[0]),
              1e3 * (x[1] - to[1]), 1e3 * (x[2] - to[2]), x[3] - to[3]);
  std::printf("longest control cycle: %.1f us of 1000\n", 1e-3 * double(longest.count()));
  return 0;
}
