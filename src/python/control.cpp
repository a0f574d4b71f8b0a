// Controllers, fault monitor and limits for Python. No mathematics.
#include "control/limit_defaults.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"
#include "python/structs.hpp"
#include "simulation/statics.hpp"

namespace truepose::python {
namespace {
/// Steady-state poses, (N, n), with optional offsets `off` of the readings, (N, n + r), and faults;
/// where there is none, whether the true robot, not the law, failed.
auto settled(const Robot& nominal, const Robot& truth, const ControlSettings& control,
             Optional<const Known> known, bool gravity, const Rows& x_d,
             const std::optional<Rows>& off, const std::vector<Fault>& faults) {
  const StaticsSettings settings{control, gravity};
  Owned<bool> by_truth({x_d.shape(0)});
  const nb::tuple found = batch(x_d.shape(0), {{x_d.shape(1)}}, [&](std::size_t i, auto& out) {
    *by_truth[i] = false;
    FaultyReadings lying(faults, control.period);
    Coordinates x{};
    const Outcome outcome =
        settle(nominal, truth, settings, row<Coordinates>(x_d, i), x,
               Weights(nominal, known.value_or(nullptr)), off ? row<Extended>(*off, i) : Extended{},
               by_truth[i], faults.empty() ? nullptr : &lying);
    copy_first(x_d.shape(1), x, out[0]);
    return outcome;
  });
  return nb::tuple(found + nb::make_tuple(by_truth.release()));
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
  Status status;
};
}  // namespace
}  // namespace truepose::python

namespace truepose::c {
TRUEPOSE_MEMBERS(python::Reviewed, believed, health, symptom, chi2, freedom, doubted, undecided,
                 status)
}  // namespace truepose::c

namespace truepose::python {
namespace {
/// Processes rows in sequence.
auto review(const FaultTolerantSetup& setup, const Rows& desired, const Rows& q_e) {
  std::vector<Reviewed> rows(q_e.shape(0));
  const Weights weights(setup.robot, &setup.known);
  FaultMonitor monitor;
  Multirate late;
  if (setup.late && !start(*setup.late, late))
    throw std::invalid_argument("period or age of a sensor: too long");
  const auto next = [&](std::size_t i) {
    Reviewed& now = rows[i];
    late.arrived = arrivals(late.settings, late.cycle);
    now.status =
        monitor_faults(setup.robot, setup.settings.monitor, weights, row<Joint>(desired, i),
                       row<Extended>(q_e, i), monitor, now.believed, setup.late ? &late : nullptr)
            .status;
    for (std::size_t c = 0; c < kMaxReadings; ++c) {
      now.health[c] = monitor.reading[c].health;
      now.symptom[c] = monitor.reading[c].symptom;
    }
    now.chi2 = monitor.chi2, now.freedom = monitor.freedom, now.doubted = monitor.doubted;
    now.undecided = monitor.undecided;
  };
  for_rows(rows.size(), next, kInOrder);
  return records(rows);
}

}  // namespace

void bind_control(nb::module_& m) {
  m.def("settle", &settled);
  nb::class_<Supervisor>(m, "Supervisor");  // of packages
  nb::class_<Guard>(m, "Guard");
  nb::class_<FaultTolerantSetup>(m, "FaultTolerantSetup")
      .def(nb::init<const Robot&, const Known&, const FaultMonitorSettings&, Optional<Supervisor>,
                    const Delays&, Optional<const SafetyLimits>>(),
           nb::keep_alive<1, 5>())
      .def_prop_ro("monitor", [](const FaultTolerantSetup& own) { return own.settings.monitor; });
  m.def("review", &review);
  m.def("default_limits", [](const Robot& robot, const ControlSettings& settings) {
    SafetyLimits derived;
    const Outcome outcome = default_limits(robot, settings, derived);
    return answered(outcome, derived);
  });
  m.def("consistent", [](const SafetyLimits& given, int motors, int freedoms) {
    return answered(consistent(given, motors, freedoms));
  });
  m.def("stopping_distance",
        [](const Robot& robot, const SafetyLimits& given, bool marked, double speed) {
          double distance = 0;
          const Outcome outcome = stopping_distance(robot, given, marked, speed, distance);
          return answered(outcome, distance);
        });
}
}  // namespace truepose::python
