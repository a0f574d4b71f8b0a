// The watch for Python: settings, what it says of a reading, and a whole log at once. No
// mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include <vector>

#include "arrays.hpp"
#include "for_rows.hpp"
#include "known.hpp"
#include "truepose/kernels.hpp"

namespace truepose::python {
namespace {

/// A watch between one line and the next.
struct Watching {
  Robot robot;
  Known known;
  Weights weights;
  WatchSettings settings;
  Watch watch;

  Watching(const Robot& watched, const Known& knowledge, const WatchSettings& given)
      : robot(watched), known(knowledge), weights(robot, &known), settings(given) {
    prepare(settings);
  }
};

/// Lines one after another: what is believed, (N, n + r), every reading's health and symptom, and
/// of each line the level of the parity, its degrees of freedom, the readings of which one is wrong
/// as bits, whether nobody will decide which, and the status.
auto review(Watching& w, const Rows& desired, const Rows& q_e) {
  const std::size_t count = q_e.shape(0), e = q_e.shape(1);
  Owned<double> believed({count, e}), chi2({count});
  Owned<int> health({count, e}), symptom({count, e}), freedom({count}), doubted({count});
  Owned<bool> undecided({count});
  Outcomes outcomes(count);
  with_mobility(w.robot.mobility, [&](auto mobility) {
    for_rows_in_order(count, [&](std::size_t i) {
      Extended values{};
      outcomes.set(i,
                   watch<mobility()>(w.robot, w.settings, w.weights.view(), row<Joint>(desired, i),
                                     row<Extended>(q_e, i), w.watch, values));
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
      .def_rw("spikes", &WatchSettings::spikes)
      .def_rw("within", &WatchSettings::within)
      .def_rw("correlation", &WatchSettings::correlation)
      .def_rw("fastest", &WatchSettings::fastest)
      .def_rw("moved", &WatchSettings::moved)
      .def_rw("low", &WatchSettings::low)
      .def_rw("high", &WatchSettings::high);
  nb::class_<Watching>(m, "Watching")
      .def(nb::init<const Robot&, const Known&, const WatchSettings&>())
      .def("review", &review, "desired"_a, "q_e"_a)
      .def("restore", [](Watching& w, int reading) { restore(w.watch, reading); });
}

}  // namespace truepose::python
