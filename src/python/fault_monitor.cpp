// The fault monitor for Python: settings, state and whole logs. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <vector>

#include "control/fastest.hpp"
#include "control/momentum_defaults.hpp"
#include "python/arrays.hpp"
#include "python/fault_tolerant_setup.hpp"
#include "python/fields.hpp"
#include "python/for_rows.hpp"

namespace truepose::python {
namespace {
/// Largest second derivatives of the readings at poses, (N, n + r).
auto batch_fastest(const Robot& robot, const Rows& x) {
  return map_rows<Coordinates, Extended>(
      x, robot.motors + robot.r,
      [&](const Coordinates& at, Extended& most, std::size_t) { return fastest(robot, at, most); });
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
}  // namespace

void bind_fault_monitor(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<FaultMonitorSettings> monitor(m, "FaultMonitorSettings");
  monitor.def(nb::init<>());
  TRUEPOSE_FIELDS(monitor, def_rw, period, false_alarm, refresh, coast, decide, replaceable, spikes,
                  within, correlation, fastest, moved, kp, kd, rests, shaken, low, high, growth,
                  memory);
  nb::class_<MomentumSettings> momentum(m, "MomentumSettings");
  momentum.def(nb::init<>());
  TRUEPOSE_FIELDS(momentum, def_rw, period, bandwidth, alarm, share, named, window, over, sigma,
                  give, carry);
  nb::class_<FaultTolerantSettings> settings(m, "FaultTolerantSettings");
  settings.def(nb::init<>());
  TRUEPOSE_FIELDS(settings, def_rw, monitor, momentum, stop, stop_lost, held);
  nb::class_<FaultTolerantSetup>(m, "FaultTolerantSetup")
      .def(nb::init<const Robot&, const Known&, const FaultTolerantSettings&,
                    const std::optional<MultirateSettings>&>(),
           "robot"_a, "known"_a, "settings"_a, "late"_a.none());
  m.def("default_momentum", [](const Robot& robot, const ControlSettings& of) {
    MomentumSettings derived;
    const Outcome outcome = default_momentum(robot, of, derived);
    return answered(outcome, derived);
  });
  m.def("review", &review, "fault_setup"_a, "desired"_a, "q_e"_a);
  m.def("fastest", &batch_fastest);
  m.attr("symptoms") =
      nb::make_tuple("", "missing", "out of range", "too fast", "stuck", "disagrees", "noisy");
}
}  // namespace truepose::python
