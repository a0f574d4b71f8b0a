// The watch for Python: settings, what it says of a reading, and a whole log at once. No
// mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <vector>

#include "arrays.hpp"
#include "for_rows.hpp"
#include "guarding.hpp"
#include "truepose/kernels.hpp"
#include "truepose/offline/fastest.hpp"

namespace truepose::python {
namespace {

/// A watch between one line and the next.
struct Watching {
  Guarding guarding;
  Weights weights;
  Watch watch;
  Late late;

  explicit Watching(const Guarding& given)
      : guarding(given), weights(guarding.robot, &guarding.known) {
    if (guarding.late) require_started(*guarding.late, late);
  }

  /// One line. @param believed  out
  template <Mobility K>
  Outcome line(const Joint& desired, const Extended& q_e, Extended& believed) {
    late.arrived = arrivals(late.settings, late.cycle);
    return truepose::watch<K>(guarding.robot, guarding.settings.watch, weights.view(), desired, q_e,
                              watch, believed, guarding.late ? &late : nullptr);
  }
};

/// Largest second derivatives of the readings at poses, (N, n + r).
auto batch_fastest(const Robot& robot, const Rows& x) {
  return map_rows<Coordinates, Extended>(
      x, robot.motors + robot.r,
      [&](const Coordinates& at, Extended& most, std::size_t) { return fastest(robot, at, most); });
}

/// Lines one after another: what is believed, (N, n + r), every reading's health and symptom, and
/// of each line the level of the parity, its degrees of freedom, the readings of which one is wrong
/// as bits, whether nobody will decide which, and the status.
auto review(Watching& w, const Rows& desired, const Rows& q_e) {
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

void bind_watch(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<WatchSettings>(m, "WatchSettings")
      .def(nb::init<>())
      .def_rw("period", &WatchSettings::period)
      .def_rw("false_alarm", &WatchSettings::false_alarm)
      .def_rw("refresh", &WatchSettings::refresh)
      .def_rw("coast", &WatchSettings::coast)
      .def_rw("decide", &WatchSettings::decide)
      .def_rw("replaceable", &WatchSettings::replaceable)
      .def_rw("spikes", &WatchSettings::spikes)
      .def_rw("within", &WatchSettings::within)
      .def_rw("correlation", &WatchSettings::correlation)
      .def_rw("fastest", &WatchSettings::fastest)
      .def_rw("moved", &WatchSettings::moved)
      .def_rw("kp", &WatchSettings::kp)
      .def_rw("kd", &WatchSettings::kd)
      .def_rw("rests", &WatchSettings::rests)
      .def_rw("shaken", &WatchSettings::shaken)
      .def_rw("low", &WatchSettings::low)
      .def_rw("high", &WatchSettings::high);
  nb::class_<GuardSettings>(m, "GuardSettings")
      .def(nb::init<>())
      .def_rw("watch", &GuardSettings::watch)
      .def_rw("stop", &GuardSettings::stop)
      .def_rw("stop_lost", &GuardSettings::stop_lost)
      .def_rw("held", &GuardSettings::held);
  nb::class_<Guarding>(m, "Guarding")
      .def(nb::init<const Robot&, const Known&, const GuardSettings&,
                    const std::optional<LateSettings>&>(),
           "robot"_a, "known"_a, "settings"_a, "late"_a.none());
  nb::class_<Watching>(m, "Watching")
      .def(nb::init<const Guarding&>())
      .def("review", &review, "desired"_a, "q_e"_a)
      .def("restore", [](Watching& w, int reading) { restore(w.watch, reading); });
  m.def("fastest", &batch_fastest);
  nb::list symptoms;
  for (const char* name : {"", "missing", "out of range", "too fast", "stuck", "disagrees"})
    symptoms.append(name);
  m.attr("symptoms") = symptoms;
}

}  // namespace truepose::python
