// Controllers and their static equilibria for Python. No mathematics.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "for_rows.hpp"
#include "known.hpp"
#include "multirate.hpp"
#include "truepose/kernels.hpp"
#include "truepose/offline/statics.hpp"

namespace truepose::python {
namespace {

auto batch_redundant_fkm(const Robot& robot, const Rows& q_e) {
  return map_rows<Extended, Coordinates>(
      q_e, dof(robot.mobility),
      [&](const Extended& at, Coordinates& x, std::size_t) { return redundant_fkm(robot, at, x); });
}

auto batch_tej(const Robot& robot, const Rows& x, double band) {
  const std::size_t count = x.shape(0), n = x.shape(1), e = n + robot.r;
  Owned<double> m({count, e, n}), plus({count, n, e});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    ExtendedColumns M;
    ExtendedRows M_plus;
    const Outcome outcome = tej(robot, row<Coordinates>(x, i), M, M_plus, band);
    outcomes.set(i, outcome);
    write(M, e, n, outcome, m[i]);
    write(M_plus, n, e, outcome, plus[i]);
  });
  return nb::make_tuple(m.release(), plus.release(), outcomes.status.release(),
                        outcomes.chain.release());
}

/// Conditioning at every pose, (N, 1 + n): type 2, then type 1 of each chain.
auto batch_conditioning(const Robot& robot, const Rows& x) {
  return map_rows<Coordinates, std::array<double, 1 + kMaxDof>>(
      x, 1 + x.shape(1), [&](const Coordinates& at, auto& values, std::size_t) {
        Joint serial{};
        const Outcome outcome = conditioning(robot, at, values[0], serial);
        std::copy(serial.begin(), serial.end(), values.begin() + 1);
        return outcome;
      });
}

/// Steady-state poses, (N, n), with optional offsets `off` of the readings, (N, n + r), and faults;
/// where there is none, whether the true robot, not the law, failed.
auto batch_settle(const Robot& nominal, const Robot& truth, const ControlSettings& control,
                  const Known* known, bool gravity, const Rows& x_d, const std::optional<Rows>& off,
                  const std::vector<Fault>& faults) {
  const StaticsSettings settings{control, gravity};
  const std::size_t count = x_d.shape(0), n = x_d.shape(1);
  Owned<double> rest({count, n});
  Owned<bool> by_truth({count});
  Outcomes outcomes(count);
  with_mobility(nominal.mobility, [&](auto mobility) {
    for_rows(count, [&](std::size_t i) {
      Coordinates x;
      x.fill(NAN);
      *by_truth[i] = false;
      FaultyReadings lying(faults, control.period);
      outcomes.set(i, settle<mobility()>(nominal, truth, settings, row<Coordinates>(x_d, i), x,
                                         Weights(nominal, known).view(),
                                         off ? row<Extended>(*off, i) : Extended{}, by_truth[i],
                                         faults.empty() ? nullptr : &lying));
      std::copy_n(x.begin(), n, rest[i]);
    });
  });
  return nb::make_tuple(rest.release(), outcomes.status.release(), outcomes.chain.release(),
                        by_truth.release());
}

/// ∂x/∂q_e of the steady-state pose under a law, (N, n, n + r).
auto batch_leakage(const Robot& robot, Law law, const Known* known, const Rows& x) {
  const std::size_t n = x.shape(1), e = n + robot.r;
  Owned<double> leak({x.shape(0), n, e});
  Outcomes outcomes(x.shape(0));
  with_mobility(robot.mobility, [&](auto mobility) {
    for_rows(x.shape(0), [&](std::size_t i) {
      const Weights weights(robot, known);
      PoseColumns rows{};
      const Outcome outcome =
          leakage<mobility()>(robot, law, row<Coordinates>(x, i), rows, weights.view());
      outcomes.set(i, outcome);
      for (std::size_t k = 0; k < n * e; ++k) leak[i][k] = outcome ? rows[k / e][k % e] : NAN;
    });
  });
  return nb::make_tuple(leak.release(), outcomes.status.release(), outcomes.chain.release());
}

}  // namespace

void bind_control(nb::module_& m) {
  using namespace nb::literals;
  nb::enum_<FeedForward>(m, "FeedForward")
      .value("none", FeedForward::none)
      .value("gravity", FeedForward::gravity)
      .value("full", FeedForward::full);
  nb::enum_<Gains>(m, "Gains").value("diagonal", Gains::diagonal).value("inertia", Gains::inertia);
  nb::class_<ControlSettings>(m, "ControlSettings")
      .def(nb::init<>())
      .def_rw("law", &ControlSettings::law)
      .def_rw("sigma_scale", &ControlSettings::sigma_scale)
      .def_rw("gains", &ControlSettings::gains)
      .def_rw("feed_forward", &ControlSettings::feed_forward)
      .def_rw("period", &ControlSettings::period)
      .def_rw("velocity_bandwidth", &ControlSettings::velocity_bandwidth)
      .def_rw("damped_below", &ControlSettings::damped_below)
      .def_rw("kp", &ControlSettings::kp)
      .def_rw("kd", &ControlSettings::kd)
      .def_rw("ki", &ControlSettings::ki)
      .def("place_poles", [](ControlSettings& settings, const Robot& robot, const Coordinates& x,
                             double frequency, double damping) {
        const Outcome outcome = place_poles(robot, x, frequency, damping, settings);
        return std::pair(static_cast<int>(outcome.status), outcome.chain);
      });
  nb::class_<ControlState>(m, "ControlState")
      .def(nb::init<>())
      .def_ro("torque", &ControlState::torque)
      .def_ro("error", &ControlState::error)
      .def_ro("rate", &ControlState::rate)
      .def(
          "step",
          [](ControlState& state, const Robot& robot, const ControlSettings& settings,
             const Coordinates& x, const Coordinates& rate, const Coordinates& acceleration,
             Extended q_e, const Known* known, Slow* slow) {
            const Weights weights(robot, known);
            const Weighing weighing =
                slow ? slow->compensate_latency(robot, weights.view(), q_e) : weights.view();
            const Outcome outcome =
                control(robot, settings, {x, rate, acceleration}, q_e, state, weighing);
            return std::pair(static_cast<int>(outcome.status), outcome.chain);
          },
          "robot"_a, "settings"_a, "x"_a, "rate"_a, "acceleration"_a, "q_e"_a,
          "known"_a.none() = nb::none(), "slow"_a.none() = nb::none());
  m.def("redundant_fkm", &batch_redundant_fkm);
  m.def("tej", &batch_tej);
  m.def("conditioning", &batch_conditioning);
  m.def("settle", &batch_settle, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(),
        "gravity"_a, "x_d"_a, "off"_a.none() = nb::none(), "faults"_a = std::vector<Fault>{});
  m.def("leakage", &batch_leakage, "robot"_a, "law"_a, "known"_a.none(), "x"_a);
}

}  // namespace truepose::python
