// A control loop at 1 kHz. Readings and setpoint in, torques out.
#include <chrono>
#include <cstdio>
#include <thread>

#include "h4.hpp"
#include "simulation/plant.hpp"  // stands for the machine

using namespace truepose;
using Clock = std::chrono::steady_clock;

int main() {
  Robot robot;  // as drawn
  if (!make_h4(robot)) return 1;
  Robot machine = robot;  // as built: one rod 3 mm too long
  machine.chain[2].rod += 0.003;
  if (!finish(machine)) return 1;

  ControlSettings settings;  // what follows from them is fixed before the loop starts
  settings.law = Law::tej;
  if (!place_poles(robot, robot.home, 120, 0.9, settings)) return 1;

  const Coordinates from{-0.05, 0, -0.42, 0.2}, to{0.05, 0.05, -0.40, -0.2};
  Joint q;
  Coordinates x = from;
  if (!ikm(robot, from, q) || !fkm(machine, q, x)) return 1;
  PlantState plant{to_pose<kH4>(x), {}};
  Random random(1);
  ControlState state;
  std::chrono::nanoseconds longest{0};

  auto next = Clock::now();
  for (int cycle = 0; cycle < 400; ++cycle) {  // 0.2 s of move, 0.2 s of rest
    std::this_thread::sleep_until(next += std::chrono::milliseconds(1));
    Extended q_e{};
    if (!measure<kH4>(machine, plant.pose, random, q_e))
      return 1;  // on a machine: the drives' counts

    const auto start = Clock::now();
    const Setpoint setpoint = quintic<kH4>(from, to, 0.2, cycle * settings.period);
    const Outcome outcome = control<kH4>(robot, settings, setpoint, q_e, state);
    longest = std::max(longest, std::chrono::nanoseconds(Clock::now() - start));
    if (!outcome) std::printf("cycle %d: %s, torque held\n", cycle, describe(outcome.status));

    if (!advance<kH4>(machine, state.torque, settings.period, 2, plant))
      return 1;  // the torques go out
  }

  x = to_coordinates<kH4>(plant.pose);
  std::printf("at x - x_d: %.3f %.3f %.3f mm, %.4f rad\n", 1e3 * (x[0] - to[0]),
              1e3 * (x[1] - to[1]), 1e3 * (x[2] - to[2]), x[3] - to[3]);
  std::printf("longest control cycle: %.1f us of 1000\n", 1e-3 * double(longest.count()));
  return 0;
}
