// Simulations for Python: runs or visits of poses, with effects, faults, multirate sensors.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <vector>

#include "python/arrays.hpp"
#include "python/fault_tolerant_setup.hpp"
#include "python/fields.hpp"
#include "python/for_rows.hpp"
#include "python/known.hpp"
#include "python/multirate.hpp"
#include "python/online_calibration.hpp"
#include "simulation/simulate.hpp"

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
    std::copy_n(q_e.begin(), width, values[i]);
  });
  return values.release();
}

/// Robots, controller, effects, faults and multirate sensors of runs.
struct Setup {
  Robot nominal, truth;
  ControlSettings settings;
  const Known* known;
  Effects effects;
  Online* online;
  std::vector<Fault> faults;
  const FaultTolerantSetup* fault_setup;
  Lateness late;
  std::vector<Event> events;
  const Safety* safety;
};

/// Weights of a simulation's readings, from Python's knowledge or a calibrator, and its faults.
class LoopExtras {
 public:
  LoopExtras(const Setup& of, std::uint64_t seed)
      : weights_(of.nominal, of.known),
        lying_(of.faults, of.settings.period, seed),
        monitor_weights_(of.fault_setup ? of.fault_setup->robot : of.nominal,
                         of.fault_setup ? &of.fault_setup->known : nullptr) {
    extras.weighing = weights_.view();
    extras.effects = of.effects;
    if (!of.faults.empty()) extras.faults = &lying_;
    extras.monitor_weighing = monitor_weights_.view();
    extras.events = of.events;
    extras.safety = of.safety;
    if (of.late.first) extras.late = &*of.late.first;
    if (of.late.second) extras.bus = &*of.late.second;
    if (of.fault_setup) {
      fault_settings_ = of.fault_setup->settings;
      fault_settings_.finest = &of.fault_setup->robot;
      extras.fault_settings = &fault_settings_;
    }
    if (of.online == nullptr) return;
    OnlineCalibrator& learner = of.online->begin(of.nominal);
    knowledge_ = learner.knowledge();
    work_.resize(estimate_work(of.nominal, knowledge_.count));
    extras.weighing = extras.monitor_weighing = {&knowledge_, work_.data()};
    extras.learner = &learner;
    fault_settings_.finest = &learner.robot;
  }

  Extras extras;

 private:
  Weights weights_;  // not to be copied: pointed to
  FaultyReadings lying_;
  Weights monitor_weights_;
  FaultTolerantSettings fault_settings_;
  Knowledge knowledge_;
  std::vector<double> work_;
};

using OwnError = std::optional<nb::callable>;

/// A Python callable (x_d, q_e) -> motor error as the loop's law.
OwnLaw own_law(const OwnError& error_of) {
  if (!error_of) return {};
  return [&](const Coordinates& x_d, const Extended& q_e) {
    const nb::gil_scoped_acquire acquire;
    return nb::cast<Joint>((*error_of)(x_d, q_e));
  };
}

/// A field of every sample, (N,), or the first `width` entries of one that is an array, (N, width).
template <class T, class Field>
nb::object column(const std::vector<Sample>& log, Field Sample::* field, std::size_t width = 0) {
  Owned<T> values(width > 0 ? Shape{log.size(), width} : Shape{log.size()});
  for (std::size_t i = 0; i < log.size(); ++i)
    if constexpr (requires(Field many) { many[0]; })
      for (std::size_t k = 0; k < width; ++k) values[i][k] = static_cast<T>((log[i].*field)[k]);
    else
      *values[i] = static_cast<T>(log[i].*field);
  return values.release();
}

/// A setpoint between two of a path that is followed more slowly, by quintic Hermite polynomials.
/// @param u  0 to 1 of the period T
Setpoint between(Mobility mobility, const Setpoint& a, const Setpoint& b, double u, double T) {
  const Pose start = to_pose(mobility, a.x);
  const Coordinates whole = difference(mobility, to_pose(mobility, b.x), start);
  Coordinates step{};
  Setpoint found;
  for (int i = 0; i < dof(mobility); ++i) {
    const double v = T * a.rate[i], c = T * T * a.acceleration[i];
    const double off = whole[i] - v - c / 2, faster = T * b.rate[i] - v - c;
    const double harder = T * T * b.acceleration[i] - c;
    const double c3 = 10 * off - 4 * faster + harder / 2, c4 = 7 * faster - 15 * off - harder;
    const double c5 = 6 * off - 3 * faster + harder / 2;
    step[i] = u * (v + u * (c / 2 + u * (c3 + u * (c4 + u * c5))));
    found.rate[i] = (v + u * (c + u * (3 * c3 + u * (4 * c4 + u * 5 * c5)))) / T;
    found.acceleration[i] = (c + u * (6 * c3 + u * (12 * c4 + u * 20 * c5))) / (T * T);
  }
  found.x = to_coordinates(mobility, moved(mobility, start, step));
  return found;
}

/// One run from rest along any path: a row of each (N, n) array per period, interpolated where the
/// robot slows down.
auto run_path(const Setup& of, const Rows& x, const Rows& rate, const Rows& acceleration, int steps,
              const Coordinates& start, std::uint64_t seed, const OwnError& error_of) {
  const std::size_t periods = x.shape(0) - 1;
  const auto at = [&](std::size_t k) {
    return Setpoint{row<Coordinates>(x, k), row<Coordinates>(rate, k),
                    row<Coordinates>(acceleration, k)};
  };
  std::vector<Sample> log;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    Signals signals;
    LoopExtras with(of, seed);
    with.extras.law = own_law(error_of);
    const auto path = [&](double k) {
      const auto before = std::min(static_cast<std::size_t>(k), periods);
      const double part = k - static_cast<double>(before);
      if (part == 0 || before == periods) return at(before);
      return between(of.nominal.mobility, at(before), at(before + 1), part, of.settings.period);
    };
    Loop loop(of.nominal, of.truth, of.settings, start, seed, with.extras);
    outcome = loop.follow(static_cast<int>(periods), steps, path, [&](const Sample& sample) {
      log.push_back(sample);
      signals();
    });
  }
  const std::size_t n = dof(of.nominal.mobility), e = n + of.nominal.r;
  return nb::make_tuple(static_cast<int>(outcome.status), outcome.chain,
                        column<double>(log, &Sample::time), column<double>(log, &Sample::x_d, n),
                        column<double>(log, &Sample::x, n), column<double>(log, &Sample::q_e, e),
                        column<double>(log, &Sample::error, n),
                        column<double>(log, &Sample::torque, n), column<int>(log, &Sample::status),
                        column<bool>(log, &Sample::gave_up), column<int>(log, &Sample::health, e),
                        column<int>(log, &Sample::symptom, e), column<bool>(log, &Sample::stops),
                        column<int>(log, &Sample::brakes), column<int>(log, &Sample::disturbance),
                        column<int>(log, &Sample::disturbed), column<double>(log, &Sample::size),
                        column<double>(log, &Sample::force, n), column<bool>(log, &Sample::refused),
                        column<bool>(log, &Sample::warm), column<int>(log, &Sample::safety),
                        column<int>(log, &Sample::cause), column<int>(log, &Sample::part));
}

/// Summary of a visit to one pose.
struct Visited {
  Sample last{};
  Coordinates low{}, high{};  ///< of x in the last kRest of the hold
  int saturated = -1;         ///< first motor at its torque limit
  int unanswered = 0;         ///< cycles without an answer of the controller,
  Status reason{};            ///< and the first one's reason

  static constexpr double kRest = 0.05;  ///< s, when a robot should rest

  /// @param end  of the run, s @param hold  at the pose, s
  void add(const Robot& nominal, const Sample& sample, double end, double hold) {
    last = sample;
    if (sample.status > Status::ok && unanswered++ == 0) reason = sample.status;
    const bool moving = sample.time <= end - std::min(kRest, hold);
    for (int k = 0; k < dof(nominal.mobility); ++k) {
      low[k] = moving ? sample.x[k] : std::min(low[k], sample.x[k]);
      high[k] = moving ? sample.x[k] : std::max(high[k], sample.x[k]);
      const double limit = nominal.chain[k].torque_limit;
      if (saturated < 0 && limit > 0 && std::fabs(sample.torque[k]) >= limit) saturated = k;
    }
  }
};

/// Visits poses in order, keeping friction and backlash: true pose, (N, n), and readings,
/// (N, n + r), at the end of each hold, the largest peak-to-peak motion of a coordinate in the last
/// kRest, the first motor at its torque limit, from 0, or -1, the status, and the number of
/// cycles without an answer of the controller, with the first reason. After a failure the robot is
/// placed at the next pose.
auto run_visit(const Setup& of, const Rows& x_d, double duration, double hold, int steps,
               const Coordinates& start, std::uint64_t seed) {
  const std::size_t count = x_d.shape(0), n = x_d.shape(1), e = n + of.nominal.r;
  Owned<double> x({count, n}), q_e({count, e}), swing({count});
  Owned<int> saturated({count}), unanswered({count}), reason({count});
  Outcomes outcomes(count);
  {
    nb::gil_scoped_release release;
    Signals signals;
    LoopExtras with(of, seed);
    Coordinates from = of.nominal.home, standing = start;
    std::optional<Loop> loop;
    for (std::size_t i = 0; i < count; ++i) {
      const Coordinates to = row<Coordinates>(x_d, i);
      const double period = of.settings.period, end = duration + hold;
      with.extras.began = i * period * std::lround(end / period);
      if (!loop) loop.emplace(of.nominal, of.truth, of.settings, standing, seed + i, with.extras);
      Visited visited;
      const Outcome outcome =
          loop->move({from, to, duration, hold, steps, 0}, [&](const Sample& sample) {
            signals();
            visited.add(of.nominal, sample, end, hold);
          });
      outcomes.set(i, outcome);
      *swing[i] = 0;
      for (std::size_t k = 0; k < n; ++k)
        *swing[i] = std::max(*swing[i], visited.high[k] - visited.low[k]);
      *saturated[i] = visited.saturated;
      *unanswered[i] = visited.unanswered;
      *reason[i] = static_cast<int>(visited.reason);
      if (outcome) {
        from = standing = to;
      } else {
        visited.last.x.fill(NAN);
        visited.last.q_e.fill(NAN);
        loop.reset();
      }
      std::copy_n(visited.last.x.begin(), n, x[i]);
      std::copy_n(visited.last.q_e.begin(), e, q_e[i]);
    }
  }
  return together(x, q_e, swing, saturated, outcomes.status, unanswered, reason);
}

/// Applies faults to healthy readings, (N, n + r), in sequence at these times.
auto faulty(FaultyReadings& faults, const std::vector<double>& time, const Rows& healthy) {
  const std::size_t count = std::min(time.size(), healthy.shape(0)), width = healthy.shape(1);
  Owned<double> read({count, width});
  for (std::size_t i = 0; i < count; ++i) {
    Extended q_e = row<Extended>(healthy, i);
    faults.make_faulty(time[i], q_e);
    std::copy_n(q_e.begin(), width, read[i]);
  }
  return read.release();
}

void bind_late(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<MultirateSettings> settings(m, "MultirateSettings");
  settings.def(nb::init<>());
  TRUEPOSE_FIELDS(settings, def_rw, every, age, sensitivity);
  nb::class_<Slow>(m, "Slow")
      .def(nb::init<const Lateness&>())
      .def("deliver", &Slow::deliver, "motors"_a, "q_e"_a);
  m.attr("oldest") = kOldest;
  m.attr("slowest") = kSlowest;
}

void bind_faults(nb::module_& m) {
  nb::enum_<FaultKind> kind(m, "FaultKind");
  nb::class_<FaultProperties> properties(m, "FaultProperties");
  TRUEPOSE_FIELDS(properties, def_ro, kind, size, lasts, at_rest, pair);
  nb::dict kinds;
  for (const FaultProperties& row : kFaultTable) {
    kind.value(row.name, row.kind);
    kinds[row.name] = nb::cast(row);
  }
  m.attr("fault_kinds") = kinds;
  m.attr("most_late") = kMostLate;
  nb::class_<Fault> fault(m, "Fault");
  fault.def(nb::init<>());
  TRUEPOSE_FIELDS(fault, def_rw, kind, reading, other, size, begin, end, count, frame);
  nb::enum_<Disturbance>(m, "DisturbanceKind")
      .value("none", Disturbance::none)
      .value("payload", Disturbance::payload)
      .value("friction", Disturbance::friction)
      .value("contact", Disturbance::contact);
  nb::class_<Event> event(m, "Event");
  event.def(nb::init<>());
  TRUEPOSE_FIELDS(event, def_rw, kind, begin, end, motor, size, force);
  nb::class_<FaultyReadings>(m, "FaultyReadings")
      .def(nb::init<const std::vector<Fault>&, double>())
      .def("read", &faulty)
      .def("frozen", &FaultyReadings::frozen);
}
}  // namespace

void bind_simulation(nb::module_& m) {
  using namespace nb::literals;
  bind_late(m);
  bind_faults(m);
  nb::class_<Effects> effects(m, "Effects");
  effects.def(nb::init<>());
  TRUEPOSE_FIELDS(effects, def_rw, backlash, friction, arm_stiffness, rod_stiffness, arm_damping,
                  ripple, phase, delayed);
  nb::class_<Setup>(m, "Loop")
      .def(nb::init<const Robot&, const Robot&, const ControlSettings&, const Known*,
                    const Effects&, Online*, const std::vector<Fault>&, const FaultTolerantSetup*,
                    const Lateness&, const std::vector<Event>&, const Safety*>(),
           "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(), "effects"_a, "online"_a.none(),
           "faults"_a, "fault_setup"_a.none(), "late"_a, "events"_a, "safety"_a.none() = nb::none(),
           nb::keep_alive<1, 5>(), nb::keep_alive<1, 7>(), nb::keep_alive<1, 9>(),
           nb::keep_alive<1, 12>())
      .def("follow", &run_path, "x"_a, "rate"_a, "acceleration"_a, "steps"_a, "at_rest"_a, "seed"_a,
           "error_of"_a.none() = nb::none())
      .def("visit", &run_visit, "x_d"_a, "duration"_a, "hold"_a, "steps"_a, "at_rest"_a, "seed"_a);
  m.def("spoil", &batch_spoil);
}
}  // namespace truepose::python
