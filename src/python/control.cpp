// Controllers, fault monitor, safety shell and start-up test for Python. No mathematics.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <optional>

#include "control/momentum_defaults.hpp"
#include "control/safety_defaults.hpp"
#include "python/fault_tolerant_setup.hpp"
#include "python/for_rows.hpp"
#include "python/known.hpp"
#include "python/multirate.hpp"
#include "python/structs.hpp"
#include "simulation/simulate.hpp"
#include "simulation/start_simulation.hpp"
#include "simulation/statics.hpp"

namespace truepose::python {
namespace {
/// Steady-state poses, (N, n), with optional offsets `off` of the readings, (N, n + r), and faults;
/// where there is none, whether the true robot, not the law, failed.
auto settled(const Robot& nominal, const Robot& truth, const ControlSettings& control,
             const Known* known, bool gravity, const Rows& x_d, const std::optional<Rows>& off,
             const std::vector<Fault>& faults) {
  const StaticsSettings settings{control, gravity};
  const Mobility mobility = nominal.mobility;
  Owned<bool> by_truth({x_d.shape(0)});
  const nb::tuple found = batch(x_d.shape(0), {{x_d.shape(1)}}, [&](std::size_t i, auto& out) {
    *by_truth[i] = false;
    FaultyReadings lying(faults, control.period);
    Coordinates x{};
    const Outcome outcome = settle(
        nominal, truth, settings, row<Coordinates>(x_d, i), x, Weights(nominal, known).view(),
        off ? row<Extended>(*off, i) : Extended{}, by_truth[i], faults.empty() ? nullptr : &lying);
    std::copy_n(x.begin(), dof(mobility), out[0]);
    return outcome;
  });
  return nb::tuple(found + together(by_truth));
}

/// Processes rows in sequence: the substituted readings, (N, n + r), every reading's health and
/// symptom, and per row the parity's χ², its degrees of freedom, the suspect readings as bits,
/// whether isolation is impossible, whether the robot is warm, and the status.
auto review(const FaultTolerantSetup& setup, const Rows& desired, const Rows& q_e) {
  const std::size_t count = q_e.shape(0), e = q_e.shape(1);
  Owned<double> believed({count, e}), chi2({count});
  Owned<int> health({count, e}), symptom({count, e}), freedom({count}), doubted({count});
  Owned<bool> undecided({count}), warm({count});
  Outcomes outcomes(count);
  const Weights weights(setup.robot, &setup.known);
  FaultMonitor monitor;
  Multirate late;
  if (setup.late) require_started(*setup.late, late);
  for_rows_in_order(count, [&](std::size_t i) {
    Extended values{};
    late.arrived = arrivals(late.settings, late.cycle);
    outcomes.set(i, monitor_faults(setup.robot, setup.settings.monitor, weights.view(),
                                   row<Joint>(desired, i), row<Extended>(q_e, i), monitor, values,
                                   setup.late ? &late : nullptr));
    for (std::size_t c = 0; c < e; ++c) {
      believed[i][c] = values[c];
      health[i][c] = static_cast<int>(monitor.reading[c].health);
      symptom[i][c] = static_cast<int>(monitor.reading[c].symptom);
    }
    *chi2[i] = monitor.chi2;
    *freedom[i] = monitor.freedom;
    *doubted[i] = static_cast<int>(monitor.doubted);
    *undecided[i] = monitor.undecided;
    *warm[i] = monitor.warm_up.warm;
  });
  return together(believed, health, symptom, chi2, freedom, doubted, undecided, warm,
                  outcomes.status);
}
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
  const int n = robot.motors, e = n + robot.r;
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

void bind_control(nb::module_& m) {
  using namespace nb::literals;
  structure<ControlState>(m, "ControlState", TRUEPOSE_MEMBERS(ControlState, torque, error, rate))
      .def(
          "step",
          [](ControlState& own, const Robot& robot, const ControlSettings& with,
             const Coordinates& x, const Coordinates& rate, const Coordinates& acceleration,
             Extended q_e, const Known* known, Slow* slow) {
            const Weights weights(robot, known);
            const Weighing weighing =
                slow ? slow->compensate_latency(robot, weights.view(), q_e) : weights.view();
            return answered(control(robot, with, {x, rate, acceleration}, q_e, own, weighing));
          },
          "robot"_a, "settings"_a, "x"_a, "rate"_a, "acceleration"_a, "q_e"_a,
          "known"_a.none() = nb::none(), "slow"_a.none() = nb::none());
  m.def("settle", &settled, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(), "gravity"_a,
        "x_d"_a, "off"_a.none() = nb::none(), "faults"_a = std::vector<Fault>{});
}

void bind_safety(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<FaultTolerantSettings>(m, "FaultTolerantSettings")
      .def(nb::init<>())
      .def_rw("monitor", &FaultTolerantSettings::monitor)
      .def_rw("momentum", &FaultTolerantSettings::momentum);
  nb::class_<FaultTolerantSetup>(m, "FaultTolerantSetup")
      .def(nb::init<const Robot&, const Known&, const FaultTolerantSettings&,
                    const std::optional<MultirateSettings>&>(),
           "robot"_a, "known"_a, "settings"_a, "late"_a.none())
      .def_prop_ro("monitor", [](const FaultTolerantSetup& own) { return own.settings.monitor; });
  m.def("default_momentum", [](const Robot& robot, const ControlSettings& of) {
    MomentumSettings derived;
    const Outcome outcome = default_momentum(robot, of, derived);
    return answered(outcome, derived);
  });
  m.def("review", &review, "fault_setup"_a, "desired"_a, "q_e"_a);
  nb::class_<Safety>(m, "Safety").def(nb::init<const SafetyLimits&, bool>());
  m.def("default_limits", [](const Robot& robot, const ControlSettings& settings) {
    SafetyLimits derived;
    const Outcome outcome = default_limits(robot, settings, derived);
    return answered(outcome, derived);
  });
  m.def("consistent", [](const SafetyLimits& given, int motors, int freedoms) {
    return answered(consistent(given, motors, freedoms));
  });
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
  m.def("simulate_start", &simulate_start, "robot"_a, "truth"_a, "control"_a, "settings"_a,
        "known"_a, "effects"_a, "faults"_a, "incremental"_a, "referenced"_a, "start"_a, "seed"_a);
}
}  // namespace truepose::python
