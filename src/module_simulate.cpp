// Simulations for Python: runs or visits of poses, with effects, faults, multirate sensors.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "fault_tolerant_setup.hpp"
#include "for_rows.hpp"
#include "known.hpp"
#include "multirate.hpp"
#include "online_calibration.hpp"
#include "truepose/kernels.hpp"
#include "truepose/offline/simulate.hpp"

namespace truepose::python {
namespace {

/// Converts exact readings, (N, n + r), to those of real encoders, with noise and quantization.
auto batch_spoil(const Robot& robot, const Rows& exact, std::uint64_t seed) {
  const std::size_t count = exact.shape(0), width = exact.shape(1);
  Owned<double> values({count, width});
  Random random(seed);
  for_rows_in_order(count, [&](std::size_t i) {
    Extended q_e = row<Extended>(exact, i);
    spoil(robot, random, q_e);
    std::memcpy(values[i], q_e.data(), width * sizeof(double));
  });
  return values.release();
}

/// Weights of a simulation's readings, from Python's knowledge or a calibrator, and its faults.
class LoopExtras {
 public:
  LoopExtras(const Robot& nominal, const Known* known, const Effects& effects, Online* online,
             const std::vector<Fault>& faults, const FaultTolerantSetup* guarding,
             const Lateness& late, double period)
      : weights_(nominal, known),
        online_(online),
        lying_(faults, period),
        watching_(guarding ? guarding->robot : nominal, guarding ? &guarding->known : nullptr) {
    extras.weighing = weights_.view();
    extras.effects = effects;
    if (!faults.empty()) extras.faults = &lying_;
    extras.watching = watching_.view();
    if (late.first) extras.late = &*late.first;
    if (late.second) extras.bus = &*late.second;
    if (guarding) {
      guarding_ = guarding->settings;
      guarding_.finest = &guarding->robot;
      extras.guarding = &guarding_;
    }
    if (online == nullptr) return;
    learner_ = online->learner(nominal);
    knowledge_ = learner_.knowledge();
    work_.resize(estimate_work(nominal, knowledge_.count));
    extras.weighing = extras.watching = {&knowledge_, work_.data()};
    extras.learner = &learner_;
    guarding_.finest = &learner_.robot;
  }
  ~LoopExtras() {
    if (online_) online_->take(learner_);
  }
  LoopExtras(const LoopExtras&) = delete;
  LoopExtras& operator=(const LoopExtras&) = delete;

  Extras extras;

 private:
  Weights weights_;
  Online* online_;
  FaultyReadings lying_;
  Weights watching_;
  FaultTolerantSettings guarding_;
  OnlineCalibrator learner_;
  Knowledge knowledge_;
  std::vector<double> work_;
};

using OwnTorque = std::optional<nb::callable>;

/// A Python callable (time, x, rate, acceleration, q_e, torque) -> torques as the loop's law,
/// within the motors' limits.
OwnLaw own_law(const Robot& robot, const OwnTorque& torque_of) {
  if (!torque_of) return {};
  return [&](double time, const Setpoint& setpoint, const Extended& q_e, Joint& torque) -> Outcome {
    const nb::gil_scoped_acquire acquire;
    const auto asked = nb::cast<Joint>(
        (*torque_of)(time, setpoint.x, setpoint.rate, setpoint.acceleration, q_e, torque));
    const int n = dof(robot.mobility);
    if (!all_finite(asked, n)) return {Status::not_finite, -1};
    for (int i = 0; i < n; ++i) {
      const double limit = robot.chain[i].torque_limit;
      torque[i] = limit > 0 ? std::clamp(asked[i], -limit, limit) : asked[i];
    }
    return {};
  };
}

/// One run from rest: `run` is called with the loop and the receiver of its samples.
template <class Run>
auto logged(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
            const Known* known, const Effects& effects, Online* online,
            const std::vector<Fault>& faults, const FaultTolerantSetup* guarding,
            const Lateness& late, const OwnTorque& torque_of, const Coordinates& start,
            std::uint64_t seed, std::size_t periods, Run&& run) {
  const std::size_t n = dof(nominal.mobility), e = n + nominal.r;
  std::vector<Sample> log;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    Signals signals;
    LoopExtras with(nominal, known, effects, online, faults, guarding, late, settings.period);
    with.extras.law = own_law(nominal, torque_of);
    log.reserve(periods + 1);
    outcome = with_mobility(nominal.mobility, [&](auto mobility) {
      constexpr Mobility K = mobility();
      Loop<K> loop(nominal, truth, settings, start, seed, with.extras);
      return run(loop, [&](const Sample& sample) {
        log.push_back(sample);
        signals();
      });
    });
  }
  const std::size_t count = log.size();
  Owned<double> time({count}), x_d({count, n}), x({count, n}), q_e({count, e}), error({count, n}),
      torque({count, n});
  Owned<int> status({count}), health({count, e}), symptom({count, e}), brakes({count});
  Owned<bool> gave_up({count}), stops({count});
  for (std::size_t i = 0; i < count; ++i) {
    *time[i] = log[i].time;
    std::memcpy(x_d[i], log[i].x_d.data(), n * sizeof(double));
    std::memcpy(x[i], log[i].x.data(), n * sizeof(double));
    std::memcpy(q_e[i], log[i].q_e.data(), e * sizeof(double));
    std::memcpy(error[i], log[i].error.data(), n * sizeof(double));
    std::memcpy(torque[i], log[i].torque.data(), n * sizeof(double));
    *status[i] = static_cast<int>(log[i].status);
    *gave_up[i] = log[i].gave_up;
    for (std::size_t c = 0; c < e; ++c) {
      health[i][c] = static_cast<int>(log[i].health[c]);
      symptom[i][c] = static_cast<int>(log[i].symptom[c]);
    }
    *stops[i] = log[i].stops;
    *brakes[i] = static_cast<int>(log[i].brakes);
  }
  return nb::make_tuple(static_cast<int>(outcome.status), outcome.chain, time.release(),
                        x_d.release(), x.release(), q_e.release(), error.release(),
                        torque.release(), status.release(), gave_up.release(), health.release(),
                        symptom.release(), stops.release(), brakes.release());
}

auto run_simulation(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
                    const Known* known, const Effects& effects, Online* online,
                    const std::vector<Fault>& faults, const FaultTolerantSetup* guarding,
                    const Lateness& late, const Coordinates& from, const Coordinates& to,
                    double duration, double hold, int steps, const Coordinates& start,
                    std::uint64_t seed, const OwnTorque& torque_of) {
  return logged(nominal, truth, settings, known, effects, online, faults, guarding, late, torque_of,
                start, seed, static_cast<std::size_t>((duration + hold) / settings.period) + 1,
                [&](auto& loop, auto&& write) {
                  return loop.move({from, to, duration, hold, steps}, write);
                });
}

/// Along any path: a row of each (N, n) array per period, interpolated where the robot slows down.
auto run_path(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
              const Known* known, const Effects& effects, Online* online,
              const std::vector<Fault>& faults, const FaultTolerantSetup* guarding,
              const Lateness& late, const Rows& x, const Rows& rate, const Rows& acceleration,
              int steps, const Coordinates& start, std::uint64_t seed, const OwnTorque& torque_of) {
  const std::size_t periods = x.shape(0) - 1;
  const auto at = [&](std::size_t k) {
    return Setpoint{row<Coordinates>(x, k), row<Coordinates>(rate, k),
                    row<Coordinates>(acceleration, k)};
  };
  return logged(nominal, truth, settings, known, effects, online, faults, guarding, late, torque_of,
                start, seed, periods, [&](auto& loop, auto&& write) {
                  return loop.follow(
                      static_cast<int>(periods), steps,
                      [&](double k) {
                        const auto before = std::min(static_cast<std::size_t>(k), periods);
                        const Setpoint setpoint = at(before);
                        if (k == static_cast<double>(before) || before == periods) return setpoint;
                        return between(nominal.mobility, setpoint, at(before + 1),
                                       k - static_cast<double>(before));
                      },
                      write);
                });
}

inline constexpr double kWatched = 0.05;  ///< s at the end of a hold, when a robot should rest

bool at_limit(const Chain& chain, double torque) {
  return chain.torque_limit > 0 && std::fabs(torque) >= chain.torque_limit;
}

/// Visits poses in order, keeping friction and backlash: true pose, (N, n), and readings,
/// (N, n + r), at the end of each hold, the largest peak-to-peak motion of a coordinate in the last
/// kWatched, the first motor at its torque limit, from 0, or -1, the status, and the number of
/// cycles without an answer of the controller, with the first reason. After a failure the robot is
/// placed at the next pose.
auto run_visit(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
               const Known* known, const Effects& effects, Online* online,
               const std::vector<Fault>& faults, const FaultTolerantSetup* guarding,
               const Lateness& late, const Rows& x_d, double duration, double hold, int steps,
               const Coordinates& start, std::uint64_t seed) {
  const std::size_t count = x_d.shape(0), n = x_d.shape(1), e = n + nominal.r;
  Owned<double> x({count, n}), q_e({count, e}), swing({count});
  Owned<int> saturated({count}), unanswered({count}), reason({count});
  Outcomes outcomes(count);
  {
    nb::gil_scoped_release release;
    Signals signals;
    LoopExtras loop_extras(nominal, known, effects, online, faults, guarding, late,
                           settings.period);
    Extras& extras = loop_extras.extras;
    with_mobility(nominal.mobility, [&](auto mobility) {
      constexpr Mobility K = mobility();
      Coordinates from = nominal.home, standing = start;
      std::optional<Loop<K>> loop;
      for (std::size_t i = 0; i < count; ++i) {
        const Coordinates to = row<Coordinates>(x_d, i);
        extras.began = i * settings.period * std::lround((duration + hold) / settings.period);
        if (!loop) loop.emplace(nominal, truth, settings, standing, seed + i, extras);
        Sample last{};
        Coordinates low{}, high{};
        const double end = duration + hold - std::min(kWatched, hold);
        int& held = *saturated[i];
        held = -1;
        *unanswered[i] = *reason[i] = 0;
        const Outcome outcome =
            loop->move({from, to, duration, hold, steps, 0}, [&](const Sample& sample) {
              signals();
              last = sample;
              if (sample.status > Status::ok && (*unanswered[i])++ == 0)
                *reason[i] = static_cast<int>(sample.status);
              const bool first = sample.time <= end;
              for (std::size_t k = 0; k < n; ++k) {
                low[k] = first ? sample.x[k] : std::min(low[k], sample.x[k]);
                high[k] = first ? sample.x[k] : std::max(high[k], sample.x[k]);
                if (held < 0 && at_limit(nominal.chain[k], sample.torque[k])) held = k;
              }
            });
        outcomes.set(i, outcome);
        *swing[i] = 0;
        for (std::size_t k = 0; k < n; ++k) *swing[i] = std::max(*swing[i], high[k] - low[k]);
        if (outcome) {
          from = standing = to;
        } else {
          last.x.fill(NAN);
          last.q_e.fill(NAN);
          loop.reset();
        }
        std::memcpy(x[i], last.x.data(), n * sizeof(double));
        std::memcpy(q_e[i], last.q_e.data(), e * sizeof(double));
      }
    });
  }
  return nb::make_tuple(x.release(), q_e.release(), swing.release(), saturated.release(),
                        outcomes.status.release(), unanswered.release(), reason.release());
}

/// Applies faults to healthy readings, (N, n + r), in sequence at these times.
auto faulty(FaultyReadings& faults, const std::vector<double>& time, const Rows& healthy) {
  const std::size_t count = std::min(time.size(), healthy.shape(0)), width = healthy.shape(1);
  Owned<double> read({count, width});
  for (std::size_t i = 0; i < count; ++i) {
    Extended q_e = row<Extended>(healthy, i);
    faults.read(time[i], q_e);
    std::copy_n(q_e.begin(), width, read[i]);
  }
  return read.release();
}

void bind_late(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<MultirateSettings>(m, "MultirateSettings")
      .def(nb::init<>())
      .def_rw("every", &MultirateSettings::every)
      .def_rw("age", &MultirateSettings::age)
      .def_rw("sensitivity", &MultirateSettings::sensitivity);
  nb::class_<Slow>(m, "Slow")
      .def(nb::init<const Lateness&>())
      .def("deliver", &Slow::deliver, "motors"_a, "q_e"_a);
  m.attr("oldest") = kOldest;
  m.attr("slowest") = kSlowest;
}

void bind_faults(nb::module_& m) {
  nb::enum_<FaultKind> kind(m, "FaultKind");
  nb::class_<FaultProperties>(m, "FaultProperties")
      .def_ro("kind", &FaultProperties::kind)
      .def_ro("size", &FaultProperties::size)
      .def_ro("lasts", &FaultProperties::lasts)
      .def_ro("at_rest", &FaultProperties::at_rest)
      .def_ro("pair", &FaultProperties::pair);
  nb::dict kinds;
  for (const FaultProperties& row : kFaultTable) {
    kind.value(row.name, row.kind);
    kinds[row.name] = nb::cast(row);
  }
  m.attr("fault_kinds") = kinds;
  m.attr("most_late") = kMostLate;
  nb::class_<Fault>(m, "Fault")
      .def(nb::init<>())
      .def_rw("kind", &Fault::kind)
      .def_rw("reading", &Fault::reading)
      .def_rw("other", &Fault::other)
      .def_rw("size", &Fault::size)
      .def_rw("begin", &Fault::begin)
      .def_rw("end", &Fault::end);
  nb::class_<FaultyReadings>(m, "FaultyReadings")
      .def(nb::init<const std::vector<Fault>&, double>())
      .def("read", &faulty);
}

}  // namespace

void bind_simulation(nb::module_& m) {
  using namespace nb::literals;
  bind_late(m);
  bind_faults(m);
  nb::class_<Effects>(m, "Effects")
      .def(nb::init<>())
      .def_rw("backlash", &Effects::backlash)
      .def_rw("friction", &Effects::friction)
      .def_rw("arm_stiffness", &Effects::arm_stiffness)
      .def_rw("rod_stiffness", &Effects::rod_stiffness)
      .def_ro("arm_damping", &Effects::arm_damping)
      .def_rw("ripple", &Effects::ripple)
      .def_rw("phase", &Effects::phase)
      .def_rw("delayed", &Effects::delayed);
  m.def("simulate", &run_simulation, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(),
        "effects"_a, "online"_a.none(), "faults"_a, "guarding"_a.none(), "late"_a, "start"_a,
        "end"_a, "duration"_a, "hold"_a, "steps"_a, "at_rest"_a, "seed"_a,
        "torque_of"_a.none() = nb::none());
  m.def("follow", &run_path, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(), "effects"_a,
        "online"_a.none(), "faults"_a, "guarding"_a.none(), "late"_a, "x"_a, "rate"_a,
        "acceleration"_a, "steps"_a, "at_rest"_a, "seed"_a, "torque_of"_a.none() = nb::none());
  m.def("visit", &run_visit, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(), "effects"_a,
        "online"_a.none(), "faults"_a, "guarding"_a.none(), "late"_a, "x_d"_a, "duration"_a,
        "hold"_a, "steps"_a, "at_rest"_a, "seed"_a);
  m.def("spoil", &batch_spoil);
}

}  // namespace truepose::python
