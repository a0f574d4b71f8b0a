// The safety shell for Python: limits, what a path needs of them, one cycle. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>

#include "control/safe_control.hpp"
#include "control/safety_defaults.hpp"
#include "python/arrays.hpp"
#include "python/fault_tolerant_setup.hpp"
#include "python/fields.hpp"
#include "simulation/simulate.hpp"

namespace truepose::python {
namespace {
/// What setpoints, (N, n) each, need of the motors, and the limits' contradiction with it.
auto path_needs(const Robot& robot, const SafetyLimits& limits, const Rows& x, const Rows& rate,
                const Rows& acceleration) {
  PathNeeds needs;
  Outcome outcome;
  for (std::size_t k = 0; k < x.shape(0) && outcome; ++k)
    outcome = include(
        robot, limits.period,
        {row<Coordinates>(x, k), row<Coordinates>(rate, k), row<Coordinates>(acceleration, k)},
        needs);
  if (outcome) outcome = contradiction(robot, limits, needs);
  return answered(outcome, needs.speed, needs.torque, needs.slew, needs.low, needs.high);
}

/// A law inside the safety shell, for an external plant: its state, and the path's clock.
struct SafeControl {
  Safety safety;
  SafetyShell shell;
  ControlState state;
  FaultTolerantState fault_state;
  PathClock clock;
  std::uint64_t frame = 0;

  explicit SafeControl(const Safety& given) : safety(given) {}

  /// One cycle. @param frozen  the frame's counter stands still @param begins  the operator's
  /// acknowledgement and start
  auto step(const Robot& robot, const ControlSettings& with, const Setpoint& setpoint, Extended q_e,
            const Known* known, Slow* slow, const FaultTolerantSetup* setup, bool frozen,
            std::pair<bool, bool> begins) {
    const Weights weights(robot, known);
    const Weights own(setup ? setup->robot : robot, setup ? &setup->known : nullptr);
    Monitored monitored;
    Weighing weighing = weights.view();
    FaultTolerantSettings settings;
    if (setup) {
      settings = setup->settings;
      settings.finest = &setup->robot;
      monitored = {&settings, &fault_state, slow && slow->known_late ? &slow->late : nullptr};
      weighing = own.view();
    } else if (slow) {
      weighing = slow->compensate_latency(robot, weighing, q_e);
    }
    SafetyCycle cycle;
    cycle.request = {begins.second, false, begins.first};
    if (!frozen) ++frame;
    cycle.counter = {safety.counted, frame};
    const Outcome outcome = control_safely(robot, with, safety.limits, clock.paced(setpoint), q_e,
                                           state, shell, cycle, weighing, monitored);
    if (!shell.follows) clock.rate = 0;
    clock.advance(with.period, shell.path_stop);
    return answered(outcome);
  }
};

/// Names of a table's rows.
template <class Table>
nb::tuple names_of(const Table& table) {
  nb::list names;
  for (const auto& row : table) names.append(row.name);
  return nb::tuple(names);
}
}  // namespace

void bind_safety(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<SafetyLimits> limits(m, "SafetyLimits");
  limits.def(nb::init<>()).def("copy", [](const SafetyLimits& own) { return own; });
  TRUEPOSE_FIELDS(limits, def_rw, period, torque, slew, tracking, deviation, speed, window, count,
                  still, kp, kd, rests, low, high, box_low, box_high, saturation, clipped, missing,
                  held, age, counter_bits, stop, brake, standstill);
  nb::class_<Safety>(m, "Safety").def(nb::init<const SafetyLimits&, bool>());
  m.attr("safety_states") = nb::make_tuple("ready", "running", "stopping", "stopped", "fault");
  m.attr("stop_causes") = names_of(kCauseTable);
  m.def("default_limits", [](const Robot& robot, const ControlSettings& settings) {
    SafetyLimits derived;
    const Outcome outcome = default_limits(robot, settings, derived);
    return answered(outcome, derived);
  });
  m.def("consistent",
        [](const SafetyLimits& given, int n) { return answered(consistent(given, n, n)); });
  m.def("path_needs", &path_needs);
  m.def("stopping_distance",
        [](const Robot& robot, const SafetyLimits& given, bool marked, double speed) {
          double distance = 0;
          const Outcome outcome = stopping_distance(robot, given, marked, speed, distance);
          return answered(outcome, distance);
        });
  nb::class_<SafeControl>(m, "SafeControl")
      .def(nb::init<const Safety&>())
      .def(
          "step",
          [](SafeControl& own, const Robot& robot, const ControlSettings& with,
             const Coordinates& x, const Coordinates& rate, const Coordinates& acceleration,
             const Extended& q_e, const Known* known, Slow* slow, const FaultTolerantSetup* setup,
             bool frozen, const std::pair<bool, bool>& begins) {
            return own.step(robot, with, {x, rate, acceleration}, q_e, known, slow, setup, frozen,
                            begins);
          },
          "robot"_a, "settings"_a, "x"_a, "rate"_a, "acceleration"_a, "q_e"_a,
          "known"_a.none() = nb::none(), "slow"_a.none() = nb::none(),
          "fault_setup"_a.none() = nb::none(), "frozen"_a = false,
          "begins"_a = std::pair{false, false})
      .def("begin", [](SafeControl& own) { own.clock = {}; })
      .def_prop_ro("time", [](const SafeControl& own) { return own.clock.time; })
      .def_prop_ro("torque", [](const SafeControl& own) { return own.shell.torque; })
      .def_prop_ro("brakes", [](const SafeControl& own) { return own.shell.brakes; })
      .def_prop_ro("follows", [](const SafeControl& own) { return own.shell.follows; })
      .def_prop_ro("health",
                   [](const SafeControl& own) {
                     std::array<int, kMaxReadings> health{};
                     for (std::size_t c = 0; c < health.size(); ++c)
                       health[c] = static_cast<int>(own.fault_state.monitor.reading[c].health);
                     return health;
                   })
      .def_prop_ro("state",
                   [](const SafeControl& own) { return static_cast<int>(own.shell.machine.state); })
      .def_prop_ro("cause",
                   [](const SafeControl& own) { return static_cast<int>(own.shell.cause); })
      .def_prop_ro("part", [](const SafeControl& own) { return own.shell.part; });
}
}  // namespace truepose::python
