// Controllers and their static equilibria for Python. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <vector>

#include "python/arrays.hpp"
#include "python/fields.hpp"
#include "python/for_rows.hpp"
#include "python/known.hpp"
#include "python/multirate.hpp"
#include "simulation/statics.hpp"

namespace truepose::python {
namespace {
auto batch_redundant_fkm(const Robot& robot, const Rows& q_e) {
  return map_rows<Extended, Coordinates>(
      q_e, dof(robot.mobility),
      [&](const Extended& at, Coordinates& x, std::size_t) { return redundant_fkm(robot, at, x); });
}

auto batch_tej(const Robot& robot, const Rows& x, double band) {
  const std::size_t n = x.shape(1), e = n + robot.r;
  return batch(x.shape(0), {{e, n}, {n, e}}, [&](std::size_t i, auto& out) {
    ExtendedColumns M;
    ExtendedRows M_plus;
    const Outcome outcome = tej(robot, row<Coordinates>(x, i), M, M_plus, band);
    write(M, e, n, out[0]);
    write(M_plus, n, e, out[1]);
    return outcome;
  });
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
  Owned<bool> by_truth({x_d.shape(0)});
  const auto settled = map_rows<Coordinates, Coordinates>(
      x_d, x_d.shape(1), [&](const Coordinates& at, Coordinates& x, std::size_t i) {
        *by_truth[i] = false;
        FaultyReadings lying(faults, control.period);
        return settle(nominal, truth, settings, at, x, Weights(nominal, known).view(),
                      off ? row<Extended>(*off, i) : Extended{}, by_truth[i],
                      faults.empty() ? nullptr : &lying);
      });
  return nb::tuple(settled + together(by_truth));
}

/// ∂x/∂q_e of the steady-state pose under a law, (N, n, n + r).
auto batch_leakage(const Robot& robot, Law law, const Known* known, const Rows& x) {
  const std::size_t n = x.shape(1), e = n + robot.r;
  return batch(x.shape(0), {{n, e}}, [&](std::size_t i, auto& out) {
    const Weights weights(robot, known);
    PoseColumns leak{};
    const Outcome outcome = leakage(robot, law, row<Coordinates>(x, i), leak, weights.view());
    write(leak, n, e, out[0]);
    return outcome;
  });
}
}  // namespace

void bind_control(nb::module_& m) {
  using namespace nb::literals;
  enumeration<FeedForward>(m, "FeedForward", {"none", "gravity", "full"});
  enumeration<Gains>(m, "Gains", {"diagonal", "inertia"});
  nb::class_<ControlSettings> settings(m, "ControlSettings");
  settings.def(nb::init<>());
  TRUEPOSE_FIELDS(settings, def_rw, law, sigma_scale, gains, feed_forward, period,
                  velocity_bandwidth, damped_below, kp, kd, ki);
  settings.def("place_poles", [](ControlSettings& own, const Robot& robot, const Coordinates& x,
                                 double frequency, double damping) {
    return answered(place_poles(robot, x, frequency, damping, own));
  });
  nb::class_<ControlState> state(m, "ControlState");
  state.def(nb::init<>());
  TRUEPOSE_FIELDS(state, def_ro, torque, error, rate);
  state.def(
      "step",
      [](ControlState& own, const Robot& robot, const ControlSettings& with, const Coordinates& x,
         const Coordinates& rate, const Coordinates& acceleration, Extended q_e, const Known* known,
         Slow* slow) {
        const Weights weights(robot, known);
        const Weighing weighing =
            slow ? slow->compensate_latency(robot, weights.view(), q_e) : weights.view();
        return answered(control(robot, with, {x, rate, acceleration}, q_e, own, weighing));
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
