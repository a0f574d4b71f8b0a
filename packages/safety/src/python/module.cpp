// The Python module of start-up test, safety shell and momentum observer. No mathematics.
#include "control/limit_defaults.hpp"
#include "offline/start_simulation.hpp"
#include "python/held.hpp"
#include "safety/momentum_defaults.hpp"
#include "safety/safety_guard.hpp"

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

/// The observer of a robot under a controller; None: a motor has no torque limit.
/// @param carry  whether an identified payload is fed forward
std::optional<MomentumSupervisor> momentum(const Robot& robot, const ControlSettings& control,
                                           bool carry) {
  MomentumSettings settings;
  if (!default_momentum(robot, control, settings)) return {};
  settings.carry = carry;
  return MomentumSupervisor(settings);
}

/// A safety shell. @param counted  whether frames carry a counter
SafetyGuard guard(const SafetyLimits& limits, bool counted) {
  SafetyGuard made;
  made.limits = limits;
  made.counted = counted;
  return made;
}
}  // namespace
}  // namespace truepose::python

NB_MODULE(_safety, m) {
  using namespace truepose;
  python::nb::module_::import_("truepose._core");  // has the classes of arguments, and Supervisor
  m.def("simulate_start", &python::simulated);
  python::nb::class_<MomentumSupervisor, Supervisor>(m, "Momentum");
  m.def("momentum", &python::momentum);
  python::nb::class_<SafetyGuard, Guard>(m, "SafetyGuard");
  m.def("guard", &python::guard);
}
