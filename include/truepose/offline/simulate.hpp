// What happens when a controller drives a robot? The closed loop: nominal controller, true plant.
#pragma once

#include "truepose/control.hpp"
#include "truepose/offline/plant.hpp"

namespace truepose {

/// A run: a straight quintic move, then holding its end.
struct Run {
  Joint from{}, to{};
  double duration = 0.2;   ///< of the move, s
  double hold = 0.2;       ///< afterwards, s
  int steps = 2;           ///< integration steps in one control period
  std::uint64_t seed = 0;  ///< of the readings' noise
};

/// One line of the log, at the start of a control period.
struct Sample {
  double time;
  Joint x_d, x;  ///< desired; true
  Extended q_e;  ///< as read
  Joint error;   ///< ê_q
  Joint torque;
  Status status;  ///< of the controller: ok or near_singular
};

/// Runs the loop; `write(sample)` is called once per period, end included. The robot starts at
/// rest where `start` says (its true pose).
/// @return the first failure and what the log holds up to it, or ok
template <Mobility K, class Write>
inline Outcome simulate(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
                        const Run& run, const Joint& start, Write&& write,
                        const Weighing& weighing = {}) {
  PlantState plant{to_pose<K>(start), {}};
  ControlState state;
  Random random(run.seed);
  const int periods = static_cast<int>(std::lround((run.duration + run.hold) / settings.period));
  for (int k = 0; k <= periods; ++k) {
    const double time = k * settings.period;
    const Setpoint setpoint = quintic<K>(run.from, run.to, run.duration, time);
    Extended q_e{};
    Outcome outcome = measure<K>(truth, plant.pose, random, q_e);
    if (outcome) outcome = control<K>(nominal, settings, setpoint, q_e, state, weighing);
    if (!outcome) return outcome;
    write(Sample{time, setpoint.x, to_coordinates<K>(plant.pose), q_e, state.error, state.torque,
                 outcome.status});
    if (k < periods) outcome = advance<K>(truth, state.torque, settings.period, run.steps, plant);
    if (!outcome) return outcome;
  }
  return {};
}

}  // namespace truepose
