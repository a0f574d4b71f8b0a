// Simulation of a start-up test: the true robot with brakes, miswired readings.
#include "offline/start_simulation.hpp"

namespace truepose {
Outcome simulate_start(const Robot& robot, const Robot& truth, const StartSettings& settings,
                       const SafetyLimits& limits, const Weighing& weighing, const Effects& effects,
                       const StartRun& run, SimulatedStart& result) {
  const int n = robot.motors;
  const int rows = n + robot.r;
  const Pose start = to_pose(robot.mobility, run.start);
  Plant plant(truth, effects, start, run.seed);
  FaultyReadings faults(run.faults, limits.period);
  Extended first{};
  Outcome outcome = plant.rest();
  if (outcome) outcome = plant.measure(first);
  if (!outcome) return outcome;
  plant.engage();
  result = {};
  const int most = static_cast<int>(600 / limits.period);
  for (int k = 0; k < most; ++k) {
    Extended q_e{};
    outcome = plant.measure(q_e);
    if (!outcome) return outcome;
    const Extended zero = run.incremental ? first : Extended{};
    for (int c = 0; c < rows; ++c) q_e[c] -= zero[c];
    faults.make_faulty(k * limits.period, q_e);
    for (int c = 0; c < rows; ++c) q_e[c] += zero[c];

    StartTest& test = result.test;
    start_test(robot, settings, limits, q_e, run.referenced, test, weighing);
    plant.work_brakes(test.brakes, limits.period);
    outcome = plant.advance(test.torque, limits.period, 2);
    if (!outcome) return outcome;

    double away = 0;
    for (int j = 0; j < positions_of(robot.mobility); ++j)
      away += std::pow(plant.pose().D[j] - start.D[j], 2);
    result.moved = std::max(result.moved, std::sqrt(away));
    result.seconds = k * limits.period;
    bool still = test.state >= StartState::passed;
    for (int i = 0; i < n; ++i) {
      result.torque[i] = std::max(result.torque[i], std::fabs(test.torque[i]));
      still = still && test.torque[i] == 0;
    }
    if (still) return outcome;
  }
  return {Status::not_converged, -1};
}
}  // namespace truepose
