// The Python module of the start-up test. No mathematics.
#include "control/safety_defaults.hpp"
#include "offline/start_simulation.hpp"
#include "python/held.hpp"

namespace truepose::python {
namespace {
/// Simulates a start. Classes of arguments are those of truepose._core.
/// @return finding, its parts, candidates and exchangeable readings as bits, scale and σ of each
/// reading, the platform's motion, each motor's largest torque, the duration; and the outcome
auto simulated(const Robot& robot, const Robot& truth, const ControlSettings& control,
               double motion, int pairs, const Known& known, const Effects& effects,
               const std::vector<Fault>& faults, bool incremental, bool referenced,
               const Coordinates& start, std::uint64_t seed) {
  StartSettings settings;
  settings.motion = motion, settings.pairs = pairs, settings.friction = effects.friction;
  SafetyLimits limits;
  SimulatedStart run;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    const Weights weights(robot, &known);
    outcome = default_limits(robot, control, limits);
    if (outcome)
      outcome = simulate_start(robot, truth, settings, limits, weights, effects,
                               {faults, incremental, referenced, start, seed}, run);
  }
  const StartReport& report = run.test;
  return answered(outcome, kStartFindings[static_cast<std::size_t>(report.finding)], report.part,
                  report.other, report.candidates, report.exchangeable, report.scale, report.sigma,
                  run.moved, run.torque, run.seconds);
}
}  // namespace
}  // namespace truepose::python

NB_MODULE(_safety, m) { m.def("simulate_start", &truepose::python::simulated); }
