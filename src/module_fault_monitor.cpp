// The fault monitor for Python: settings, state and whole logs. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <vector>

#include "arrays.hpp"
#include "fault_tolerant_setup.hpp"
#include "for_rows.hpp"
#include "truepose/kernels.hpp"
#include "truepose/offline/fastest.hpp"

namespace truepose::python {
namespace {

/// A fault monitor with its state between rows.
struct FaultMonitorRun {
  FaultTolerantSetup guarding;
  Weights weights;
  FaultMonitor watch;
  Multirate late;

  explicit FaultMonitorRun(const FaultTolerantSetup& given)
      : guarding(given), weights(guarding.robot, &guarding.known) {
    if (guarding.late) require_started(*guarding.late, late);
  }

  /// Processes one row. @param believed  out
  template <Mobility K>
  Outcome line(const Joint& desired, const Extended& q_e, Extended& believed) {
    late.arrived = arrivals(late.settings, late.cycle);
    return truepose::monitor_faults<K>(guarding.robot, guarding.settings.watch, weights.view(),
                                       desired, q_e, watch, believed,
                                       guarding.late ? &late : nullptr);
  }
};

/// Largest second derivatives of the readings at poses, (N, n + r).
auto batch_fastest(const Robot& robot, const Rows& x) {
  return map_rows<Coordinates, Extended>(
      x, robot.motors + robot.r,
      [&](const Coordinates& at, Extended& most, std::size_t) { return fastest(robot, at, most); });
}

/// Processes rows in sequence: the substituted readings, (N, n + r), every reading's health and
/// symptom, and per row the parity's χ², its degrees of freedom, the suspect readings as bits,
/// whether isolation is impossible, and the status.
auto review(FaultMonitorRun& w, const Rows& desired, const Rows& q_e) {
  const std::size_t count = q_e.shape(0), e = q_e.shape(1);
  Owned<double> believed({count, e}), chi2({count});
  Owned<int> health({count, e}), symptom({count, e}), freedom({count}), doubted({count});
  Owned<bool> undecided({count});
  Outcomes outcomes(count);
  with_mobility(w.guarding.robot.mobility, [&](auto mobility) {
    for_rows_in_order(count, [&](std::size_t i) {
      Extended values{};
      outcomes.set(i, w.line<mobility()>(row<Joint>(desired, i), row<Extended>(q_e, i), values));
      for (std::size_t c = 0; c < e; ++c) {
        believed[i][c] = values[c];
        health[i][c] = static_cast<int>(w.watch.reading[c].health);
        symptom[i][c] = static_cast<int>(w.watch.reading[c].symptom);
      }
      *chi2[i] = w.watch.chi2;
      *freedom[i] = w.watch.freedom;
      *doubted[i] = static_cast<int>(w.watch.doubted);
      *undecided[i] = w.watch.undecided;
    });
  });
  return nb::make_tuple(believed.release(), health.release(), symptom.release(), chi2.release(),
                        freedom.release(), doubted.release(), undecided.release(),
                        outcomes.status.release());
}

}  // namespace

void bind_fault_monitor(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<FaultMonitorSettings>(m, "FaultMonitorSettings")
      .def(nb::init<>())
      .def_rw("period", &FaultMonitorSettings::period)
      .def_rw("false_alarm", &FaultMonitorSettings::false_alarm)
      .def_rw("refresh", &FaultMonitorSettings::refresh)
      .def_rw("coast", &FaultMonitorSettings::coast)
      .def_rw("decide", &FaultMonitorSettings::decide)
      .def_rw("replaceable", &FaultMonitorSettings::replaceable)
      .def_rw("spikes", &FaultMonitorSettings::spikes)
      .def_rw("within", &FaultMonitorSettings::within)
      .def_rw("correlation", &FaultMonitorSettings::correlation)
      .def_rw("fastest", &FaultMonitorSettings::fastest)
      .def_rw("moved", &FaultMonitorSettings::moved)
      .def_rw("kp", &FaultMonitorSettings::kp)
      .def_rw("kd", &FaultMonitorSettings::kd)
      .def_rw("rests", &FaultMonitorSettings::rests)
      .def_rw("shaken", &FaultMonitorSettings::shaken)
      .def_rw("low", &FaultMonitorSettings::low)
      .def_rw("high", &FaultMonitorSettings::high);
  nb::class_<FaultTolerantSettings>(m, "FaultTolerantSettings")
      .def(nb::init<>())
      .def_rw("watch", &FaultTolerantSettings::watch)
      .def_rw("stop", &FaultTolerantSettings::stop)
      .def_rw("stop_lost", &FaultTolerantSettings::stop_lost)
      .def_rw("held", &FaultTolerantSettings::held);
  nb::class_<FaultTolerantSetup>(m, "FaultTolerantSetup")
      .def(nb::init<const Robot&, const Known&, const FaultTolerantSettings&,
                    const std::optional<MultirateSettings>&>(),
           "robot"_a, "known"_a, "settings"_a, "late"_a.none());
  nb::class_<FaultMonitorRun>(m, "FaultMonitorRun")
      .def(nb::init<const FaultTolerantSetup&>())
      .def("review", &review, "desired"_a, "q_e"_a)
      .def("restore", [](FaultMonitorRun& w, int reading) { acknowledge(w.watch, reading); });
  m.def("fastest", &batch_fastest);
  nb::list symptoms;
  for (const char* name : {"", "missing", "out of range", "too fast", "stuck", "disagrees"})
    symptoms.append(name);
  m.attr("symptoms") = symptoms;
}

}  // namespace truepose::python
