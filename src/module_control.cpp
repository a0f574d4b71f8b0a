// Controllers for Python, what they rest on and where they take a robot. No mathematics.
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
#include "guarding.hpp"
#include "known.hpp"
#include "online.hpp"
#include "truepose/kernels.hpp"
#include "truepose/offline/simulate.hpp"
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

/// Type 2 of every pose, then type 1 of each of its chains, (N, 1 + n).
auto batch_conditioning(const Robot& robot, const Rows& x) {
  return map_rows<Coordinates, std::array<double, 1 + kMaxDof>>(
      x, 1 + x.shape(1), [&](const Coordinates& at, auto& values, std::size_t) {
        Joint serial{};
        const Outcome outcome = conditioning(robot, at, values[0], serial);
        std::copy(serial.begin(), serial.end(), values.begin() + 1);
        return outcome;
      });
}

/// Poses at rest, (N, n), the readings off by `off`, (N, n + r), if by anything, and faulty; where
/// there is none, whether it was the true robot that could not stand there.
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

/// ∂x/∂q_e of a robot at rest under a law, (N, n, n + r).
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

/// Exact readings (N, n + r) as real encoders give them: with noise, in counts.
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

/// Slow and late sensors, as the controller knows them and as they are.
using Lateness = std::pair<std::optional<LateSettings>, std::optional<LateSettings>>;

/// What a simulation weighs its readings by, Python's knowledge or what a learner has learnt, and
/// which of them lie.
class LoopExtras {
 public:
  LoopExtras(const Robot& nominal, const Known* known, const Effects& effects, Online* online,
             const std::vector<Fault>& faults, const Guarding* guarding, const Lateness& late,
             double period)
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
  GuardSettings guarding_;
  Learner learner_;
  Knowledge knowledge_;
  std::vector<double> work_;
};

using OwnTorque = std::optional<nb::callable>;

/// A Python callable (time, x, rate, acceleration, q_e, torque) -> torques as the loop's law; the
/// motors' limits hold for it too.
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

/// One run from rest: `run` is called with the loop and what takes its samples.
template <class Run>
auto logged(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
            const Known* known, const Effects& effects, Online* online,
            const std::vector<Fault>& faults, const Guarding* guarding, const Lateness& late,
            const OwnTorque& torque_of, const Coordinates& start, std::uint64_t seed,
            std::size_t periods, Run&& run) {
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
                    const std::vector<Fault>& faults, const Guarding* guarding,
                    const Lateness& late, const Coordinates& from, const Coordinates& to,
                    double duration, double hold, int steps, const Coordinates& start,
                    std::uint64_t seed, const OwnTorque& torque_of) {
  return logged(nominal, truth, settings, known, effects, online, faults, guarding, late, torque_of,
                start, seed, static_cast<std::size_t>((duration + hold) / settings.period) + 1,
                [&](auto& loop, auto&& write) {
                  return loop.move({from, to, duration, hold, steps}, write);
                });
}

/// Along any path: a row of each array, (N, n), at the start of every period. Between two, where a
/// robot slows down, what lies between.
auto run_path(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
              const Known* known, const Effects& effects, Online* online,
              const std::vector<Fault>& faults, const Guarding* guarding, const Lateness& late,
              const Rows& x, const Rows& rate, const Rows& acceleration, int steps,
              const Coordinates& start, std::uint64_t seed, const OwnTorque& torque_of) {
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

inline constexpr double kWatched = 0.05;  ///< s at the end of a hold, in which a robot should rest

bool at_limit(const Chain& chain, double torque) {
  return chain.torque_limit > 0 && std::fabs(torque) >= chain.torque_limit;
}

/// From pose to pose in their order, the last one's friction and play carried on: true pose, (N,
/// n), readings, (N, n + r), at the end of each hold, the largest peak-to-peak motion of a
/// coordinate over kWatched before, the first motor that a torque limit held back, from 0, or -1;
/// status, and the cycles in which the controller had no answer, with the first reason. After a
/// failure the robot is put at the next.
auto run_visit(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
               const Known* known, const Effects& effects, Online* online,
               const std::vector<Fault>& faults, const Guarding* guarding, const Lateness& late,
               const Rows& x_d, double duration, double hold, int steps, const Coordinates& start,
               std::uint64_t seed) {
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

/// What is read of healthy readings, (N, n + r), one after another at these times.
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

/// Slow and late sensors of a plant that is not the core's: its bus, and what is remembered.
struct Slow {
  Late late;
  Bus bus;
  bool known_late;
  Knowledge known;

  explicit Slow(const Lateness& lateness)
      : bus(lateness.second.value_or(LateSettings{})), known_late(lateness.first) {
    if (known_late) require_started(*lateness.first, late);
  }

  /// As the controller reads it, (n + r,), of what the sensors have. Once a cycle.
  Extended deliver(int motors, Extended q_e) {
    late.arrived = bus.deliver(motors, q_e);
    return q_e;
  }
  /// @param q_e  in and out @return what is known of it
  Weighing bring_up(const Robot& robot, const Weighing& weighing, Extended& q_e) {
    if (!known_late) return weighing;
    const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
      return truepose::bring_up<mobility()>(robot, late, q_e);
    });
    if (!outcome) return weighing;
    calm(robot, late, q_e);
    if (!weighing) return weighing;
    known = *weighing.known;
    weigh(robot, late, known);
    return {&known, weighing.work};
  }
};

void bind_late(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<LateSettings>(m, "LateSettings")
      .def(nb::init<>())
      .def_rw("every", &LateSettings::every)
      .def_rw("age", &LateSettings::age)
      .def_rw("stray", &LateSettings::stray);
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
                slow ? slow->bring_up(robot, weights.view(), q_e) : weights.view();
            const Outcome outcome =
                control(robot, settings, {x, rate, acceleration}, q_e, state, weighing);
            return std::pair(static_cast<int>(outcome.status), outcome.chain);
          },
          "robot"_a, "settings"_a, "x"_a, "rate"_a, "acceleration"_a, "q_e"_a,
          "known"_a.none() = nb::none(), "slow"_a.none() = nb::none());
  bind_late(m);
  bind_faults(m);
  m.def("redundant_fkm", &batch_redundant_fkm);
  m.def("tej", &batch_tej);
  m.def("conditioning", &batch_conditioning);
  m.def("settle", &batch_settle, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(),
        "gravity"_a, "x_d"_a, "off"_a.none() = nb::none(), "faults"_a = std::vector<Fault>{});
  m.def("leakage", &batch_leakage, "robot"_a, "law"_a, "known"_a.none(), "x"_a);
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
