// Online calibration in a control loop. One line of readings a cycle.
#include <cstdio>
#include <vector>

#include "h4.hpp"
#include "simulation/plant.hpp"  // stands for the machine

using namespace truepose;

namespace {

/// The drawn robot's learner, and the memory that it works in: all of it taken before the loop.
struct Memory {
  explicit Memory(const Robot& drawn) {
    const auto uncertain = [&](int of, auto parameter, double sigma) {
      column.push_back(of + static_cast<int>(parameter));
      sigmas.push_back(sigma);
    };
    for (int i = 0; i < 4; ++i) {  // what machining and assembly leave open, m and rad
      uncertain(chain_column(i), ChainParameter::rod, 3e-3);
      uncertain(chain_column(i), ChainParameter::arm, 3e-4);
      uncertain(chain_column(i), ChainParameter::encoder_offset, 2e-3);
    }
    for (int k = 0; k < drawn.r; ++k)
      uncertain(sensor_column(drawn, k), SensorParameter::offset, 3e-4);
    const int p = static_cast<int>(column.size());
    xi.resize(parameter_count(drawn));
    started = drawn_parameters(drawn, xi.data());
    root.resize(p * p);
    for (int k = 0; k < p; ++k) root[k * p + k] = sigmas[k];
    kept.resize(online_kept(p));
    work.resize(online_work(drawn, p));
    learner.drawn = &drawn;
    learner.robot = drawn;
    learner.pose = to_pose<kH4>(drawn.home);
    learner.state = {p, column.data(), xi.data(), root.data(), {}, 0, kept.data()};
    for (int i = 0; i < 4; ++i) learner.state.sigma[i] = drawn.chain[i].encoder_step;
    for (int k = 0; k < drawn.r; ++k) learner.state.sigma[4 + k] = drawn.sensor[k].step;
    learner.work = work.data();
  }
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;

  std::vector<int> column;
  std::vector<double> sigmas, xi, root, kept, work;
  OnlineCalibrator learner;
  Outcome started;  ///< refused where the robot is not finished
};

/// How far from where it is sent the machine comes to rest, mm.
double apart(const Robot& believed, const Robot& machine, const Coordinates& sent) {
  Joint q;
  Coordinates x = sent;
  if (!ikm(believed, sent, q) || !fkm(machine, q, x)) return -1;
  return 1e3 * (Vec3(x.data()) - Vec3(sent.data())).norm();
}

}  // namespace

int main() {
  Robot drawn;
  if (!make_h4(drawn)) return 1;
  const Vec3 wire[]{{0, 0.25, 0}, {-0.2, -0.2, 0}, {0.2, -0.2, 0}};  // three draw-wires
  for (const Vec3& origin : wire) {
    Sensor& sensor = drawn.sensor[drawn.r++];
    sensor.kind = SensorKind::distance;
    sensor.origin = origin;
    sensor.step = 20e-6;
  }
  Robot machine = drawn;  // as built
  machine.chain[2].rod += 0.003;
  machine.chain[0].arm -= 0.0004;
  machine.chain[1].encoder_offset += 0.002;
  if (!finish(drawn) || !finish(machine)) return 1;

  Memory memory(drawn);
  if (!memory.started) return 1;
  OnlineCalibrator& learner = memory.learner;
  const Coordinates target{0.08, -0.06, -0.38, 0.3};
  std::printf("drawn:   %.3f mm from the target\n", apart(drawn, machine, target));
  Random random(1);
  for (int cycle = 0; cycle < 4000; ++cycle) {  // 4 s at 1 kHz
    const double t = 1e-3 * cycle;
    const Coordinates sent{0.09 * std::sin(3 * t), 0.09 * std::cos(5 * t),
                           -0.4 + 0.04 * std::sin(7 * t), 0.4 * std::sin(4 * t)};
    Joint q;
    Coordinates x = sent;
    if (!ikm(learner.robot, sent, q) || !fkm(machine, q, x)) return 1;
    Extended q_e{};
    if (!measure<kH4>(machine, to_pose<kH4>(x), random, q_e)) return 1;
    const Outcome outcome = calibrate_online<kH4>(learner, q_e);  // no allocation, bounded work
    if (!outcome || outcome.status == Status::stopped)
      std::printf("cycle %d: %s\n", cycle, describe(outcome.status));
  }
  std::printf("learnt:  %.3f mm, from %ld lines\n", apart(learner.robot, machine, target),
              learner.lines);
  std::printf("chain 3's rod: %.3f mm, built %.3f\n", 1e3 * learner.robot.chain[2].rod,
              1e3 * machine.chain[2].rod);
  return 0;
}
