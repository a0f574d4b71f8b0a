// The start-up test for Python, on the simulated robot. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include <string>
#include <vector>

#include "python/arrays.hpp"
#include "python/fields.hpp"
#include "python/known.hpp"
#include "simulation/start_simulation.hpp"

namespace truepose::python {
namespace {
nb::dict simulate_start(const Robot& robot, const Robot& truth, const ControlSettings& control,
                        const StartSettings& settings, const Known& known, const Effects& effects,
                        const std::vector<Fault>& faults, bool incremental, bool referenced,
                        const Coordinates& start, std::uint64_t seed) {
  SafetyLimits limits;
  SimulatedStart run;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    const Weights weights(robot, &known);
    outcome = default_limits(robot, control, limits);
    if (outcome)
      outcome = simulate_start(robot, truth, settings, limits, weights.view(), effects,
                               {faults, incremental, referenced, start, seed}, run);
  }
  const StartTest& test = run.test;
  const int n = dof(robot.mobility), e = n + robot.r;
  nb::dict result;
  result["status"] = static_cast<int>(outcome.status);
  result["part"] = outcome.chain;
  result["passed"] = test.state == StartState::passed;
  result["finding"] = kStartFindings[static_cast<std::size_t>(test.finding)];
  result["parts"] = nb::make_tuple(test.part, test.other);
  result["candidates"] = test.candidates;
  result["exchangeable"] = test.exchangeable;
  result["scale"] = std::vector<double>(test.scale.begin(), test.scale.begin() + e);
  result["sigma"] = std::vector<double>(test.sigma.begin(), test.sigma.begin() + e);
  result["moved"] = run.moved;
  result["torque"] = std::vector<double>(run.torque.begin(), run.torque.begin() + n);
  result["seconds"] = run.seconds;
  return result;
}
}  // namespace

void bind_start_test(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<StartSettings> settings(m, "StartSettings");
  settings.def(nb::init<>());
  TRUEPOSE_FIELDS(settings, def_rw, motion, radius, pulse, pairs, settle, brake_opens, inertia,
                  weight, friction);
  m.def("simulate_start", &simulate_start, "robot"_a, "truth"_a, "control"_a, "settings"_a,
        "known"_a, "effects"_a, "faults"_a, "incremental"_a, "referenced"_a, "start"_a, "seed"_a);
}
}  // namespace truepose::python
