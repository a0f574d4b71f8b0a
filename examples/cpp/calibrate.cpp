// Online calibration: a controller identifies its robot's geometry, one row of readings a cycle.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "truepose/truepose.hpp"
#include "wired.h"  // truepose export c h4 --sensors theta,wire1,wire2,wire3 --name wired -o wired.h

using namespace truepose;

namespace {

/// Distance in mm between a target and the pose that the machine takes for it.
double apart(const Model& model, const Model& machine, const Coordinates& target) {
  Joint q;
  Coordinates x = target;
  if (!model.ikm(target, q) || !machine.fkm(q, x)) return -1;
  return 1e3 * std::hypot(x[0] - target[0], x[1] - target[1], x[2] - target[2]);
}

/// What the machine's encoders read, in whole counts, where the model sends it.
bool read(const Model& model, const Model& machine, const Coordinates& target, Extended& q_e) {
  Joint q;
  Coordinates x = target;
  if (!model.ikm(target, q) || !machine.fkm(q, x) || !machine.readings(x, q_e)) return false;
  for (int i = 0; i < machine.freedoms() + machine.sensors(); ++i) {
    const int k = i - machine.freedoms();
    const Real step = k < 0 ? wired.chain[i].encoder_step : wired.sensor[k].step;
    if (step > 0) q_e[i] = step * std::round(q_e[i] / step);
  }
  return true;
}

}  // namespace

int main() {
  Model nominal, machine;
  truepose_description built = wired_finest;
  built.chain[2].rod += 0.003;
  built.chain[0].arm -= 0.0004;
  built.chain[1].encoder_offset += 0.002;
  if (!nominal.load(wired_finest) || !machine.load(built)) return 1;

  // All memory is taken before the loop.
  truepose_online_calibrator calibrator;
  std::vector<Real> memory(truepose_online_calibrator_memory(nominal.c(), wired_knowledge.count));
  const Outcome started = outcome_of(truepose_online_calibrator_init(
      &calibrator, sizeof calibrator, nominal.c(), &wired_knowledge, memory.data(), memory.size()));
  if (!started) return 1;

  const Coordinates target{0.08, -0.06, -0.38, 0.3};
  std::printf("nominal:    %.3f mm from the target\n", apart(nominal, machine, target));
  for (int cycle = 0; cycle < 4000; ++cycle) {  // 4 s at 1 kHz
    const double t = 1e-3 * cycle;
    Extended q_e{};
    if (!read(nominal, machine,
              {0.09 * std::sin(3 * t), 0.09 * std::cos(5 * t), -0.4 + 0.04 * std::sin(7 * t),
               0.4 * std::sin(4 * t)},
              q_e))
      return 1;
    const Outcome outcome = outcome_of(truepose_online_calibrator_step(&calibrator, q_e.data()));
    if (outcome.status != Status::ok)
      std::printf("cycle %d: %s\n", cycle, describe(outcome.status));
  }

  static truepose_model identified;
  truepose_description description;
  std::int64_t used = 0, excluded = 0;
  Model calibrated;
  if (!outcome_of(truepose_online_calibrator_model(&calibrator, &identified, sizeof identified)) ||
      !outcome_of(truepose_description_of(&identified, &description)) ||
      !outcome_of(truepose_online_calibrator_samples(&calibrator, &used, &excluded)) ||
      !calibrated.load(description))
    return 1;
  std::printf("calibrated: %.3f mm, from %d rows\n", apart(calibrated, machine, target),
              static_cast<int>(used));
  std::printf("chain 3's rod: %.3f mm, built %.3f\n", 1e3 * description.chain[2].rod,
              1e3 * built.chain[2].rod);
  return 0;
}
