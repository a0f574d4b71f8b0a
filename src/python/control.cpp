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

/// The fault monitor after one row.
struct Reviewed {
  Extended believed{};                          ///< the readings or their substitutes
  std::array<Health, kMaxReadings> health{};    ///< of every reading
  std::array<Symptom, kMaxReadings> symptom{};  ///< its latest
  double chi2;                                  ///< of the parity
  int freedom;                                  ///< its degrees of freedom
  std::uint32_t doubted;                        ///< suspect readings as bits
  bool undecided;                               ///< isolation is impossible
  bool warm;
  Status status;
};

/// Processes rows in sequence.
auto review(const FaultTolerantSetup& setup, const Rows& desired, const Rows& q_e) {
  std::vector<Reviewed> rows(q_e.shape(0));
  const Weights weights(setup.robot, &setup.known);
  FaultMonitor monitor;
  Multirate late;
  if (setup.late) require_started(*setup.late, late);
  for_rows_in_order(rows.size(), [&](std::size_t i) {
    Reviewed& now = rows[i];
    late.arrived = arrivals(late.settings, late.cycle);
    now.status =
        monitor_faults(setup.robot, setup.settings.monitor, weights.view(), row<Joint>(desired, i),
                       row<Extended>(q_e, i), monitor, now.believed, setup.late ? &late : nullptr)
            .status;
    for (std::size_t c = 0; c < kMaxReadings; ++c) {
      now.health[c] = monitor.reading[c].health;
      now.symptom[c] = monitor.reading[c].symptom;
    }
    now.chi2 = monitor.chi2, now.freedom = monitor.freedom, now.doubted = monitor.doubted;
    now.undecided = monitor.undecided, now.warm = monitor.warm_up.warm;
  });
  return records(rows, TRUEPOSE_MEMBERS(Reviewed, believed, health, symptom, chi2, freedom, doubted,
                                        undecided, warm, status));
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
  auto step(const Robot& robot, const ControlSettings& with, const Coordinates& x,
            const Coordinates& rate, const Coordinates& acceleration, Extended q_e,
            const Known* known, Slow* slow, const FaultTolerantSetup* setup, bool frozen,
            std::pair<bool, bool> begins) {
    const Weights weights(robot, known);
    const Weights own(setup ? setup->robot : robot, setup ? &setup->known : nullptr);
    Monitored monitored;
    Weighing weighing = weights.view();
    if (setup) {
      monitored = {&setup->settings, &fault_state,
                   slow && slow->known_late ? &slow->late : nullptr};
      weighing = own.view();
    } else if (slow) {
      weighing = slow->compensate_latency(robot, weighing, q_e);
    }
    SafetyCycle cycle;
    cycle.request = {begins.second, false, begins.first};
    if (!frozen) ++frame;
    cycle.counter = {safety.counted, frame};
    const Outcome outcome =
        control_safely(robot, with, safety.limits, clock.paced({x, rate, acceleration}), q_e, state,
                       shell, cycle, weighing, monitored);
    if (!shell.follows) clock.rate = 0;
    clock.advance(with.period, shell.path_stop);
    return answered(outcome);
  }
};

/// The report, the platform's motion, each motor's largest torque, and the duration.
auto run_start(const Robot& robot, const Robot& truth, const ControlSettings& control,
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
  const StartReport& report = run.test;
  return answered(outcome, report, run.moved, run.torque, run.seconds);
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
  nb::class_<FaultTolerantSetup>(m, "FaultTolerantSetup")
      .def(nb::init<const Robot&, const Known&, const FaultMonitorSettings&,
                    const MomentumSettings&, const std::optional<MultirateSettings>&>(),
           "robot"_a, "known"_a, "monitor"_a, "momentum"_a, "late"_a.none())
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
      .def("step", &SafeControl::step, "robot"_a, "settings"_a, "x"_a, "rate"_a, "acceleration"_a,
           "q_e"_a, "known"_a.none() = nb::none(), "slow"_a.none() = nb::none(),
           "fault_setup"_a.none() = nb::none(), "frozen"_a = false,
           "begins"_a = std::pair{false, false})
      .def("begin", [](SafeControl& own) { own.clock = {}; })
      .def_prop_ro("time", [](const SafeControl& own) { return own.clock.time; })
      .def_prop_ro("report", [](const SafeControl& own) -> SafetyReport { return own.shell; });
  m.def("simulate_start", &run_start, "robot"_a, "truth"_a, "control"_a, "settings"_a, "known"_a,
        "effects"_a, "faults"_a, "incremental"_a, "referenced"_a, "start"_a, "seed"_a);
}
}  // namespace truepose::python
