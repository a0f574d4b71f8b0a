// Simulations for Python: runs or visits of poses, with effects, faults, multirate sensors.
#include "simulation/simulate.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"
#include "python/structs.hpp"
#include "simulation/assembly.hpp"

namespace truepose::python {
namespace {
/// Summary of a visit to one pose.
struct Visited {
  Coordinates x{};  ///< true pose, and readings, at the end of the hold
  Extended q_e{};
  Coordinates low{}, high{};  ///< of x in the last kRest of the hold
  int saturated = -1;         ///< first motor at its torque limit, from 0
  Status status{};
  int unanswered = 0;  ///< cycles without an answer of the controller,
  Status reason{};     ///< and the first one's reason

  static constexpr double kRest = 0.05;  ///< s, when a robot should rest

  /// @param end  of the run, s @param hold  at the pose, s
  void add(const Robot& nominal, const Sample& sample, double end, double hold) {
    x = sample.x, q_e = sample.q_e;
    if (sample.status > Status::ok && unanswered++ == 0) reason = sample.status;
    const bool moving = sample.time <= end - min(kRest, hold);
    for (int k : range(dof(nominal.mobility))) {
      low[k] = moving ? x[k] : min(low[k], x[k]);
      high[k] = moving ? x[k] : max(high[k], x[k]);
    }
    for (int k : range(nominal.motors)) {
      const double limit = nominal.chain[k].torque_limit;
      if (saturated < 0 && limit > 0 && fabs(sample.torque[k]) >= limit) saturated = k;
    }
  }
};
}  // namespace
}  // namespace truepose::python

namespace truepose::c {
TRUEPOSE_MEMBERS(Sample, time, x_d, x, q_e, error, torque, status, gave_up, health, symptom, stops,
                 brakes, disturbance, disturbed, size, force, refused, safety, cause, part)
TRUEPOSE_MEMBERS(python::Visited, x, q_e, low, high, saturated, status, unanswered, reason)
}  // namespace truepose::c

namespace truepose::python {
namespace {
/// Readings, (N, n + r), each as `change` makes them, in sequence.
nb::object changed(const Rows& q_e,
                   const std::function<void(std::size_t i, Extended& now)>& change) {
  const std::size_t width = q_e.shape(1);
  const auto next = [&](std::size_t i, auto& out) {
    Extended now = row<Extended>(q_e, i);
    change(i, now);
    copy_first(width, now, out[0]);
    return Outcome{};
  };
  return batch(q_e.shape(0), {{width}}, next, kInOrder)[0];
}

/// Converts exact readings to those of real encoders, with noise and quantization.
auto batch_spoil(const Robot& robot, const Rows& exact, std::uint64_t seed) {
  Random random(seed);
  return changed(exact, [&](std::size_t, Extended& q_e) { spoil(robot, random, q_e); });
}

/// Applies faults to healthy readings in sequence at these times.
auto faulty(FaultyReadings& faults, const std::vector<double>& time, const Rows& healthy) {
  return changed(healthy,
                 [&](std::size_t i, Extended& q_e) { faults.make_faulty(time.at(i), q_e); });
}

/// Simulated runs, or visits of poses, of one true robot under a controller, as Python gives them.
struct Simulation {
  Robot nominal, truth;
  ControlSettings settings;
  Optional<const Known> known;
  Effects effects;
  Optional<Online> online;
  std::vector<Fault> faults;
  Optional<const FaultTolerantSetup> monitor;
  Lateness delays;
  std::vector<Event> events;
  Optional<Guard> guard;
  int steps;
  Coordinates start;
  std::uint64_t seed;

  nb::tuple follow(const Rows& x, const Rows& rate, const Rows& acceleration,
                   const std::optional<nb::callable>& error_of) const;
  nb::object visit(const Rows& x_d, double duration, double hold) const;
};

/// What a loop of a simulation points to.
struct Given : Extras {
  Weights own, monitored;
  FaultyReadings wrong;
  FaultTolerantSettings tolerant;

  explicit Given(const Simulation& of)
      : own(of.nominal, of.known.value_or(nullptr)),
        monitored(of.nominal, nullptr),
        wrong(of.faults, of.settings.period, of.seed) {
    effects = of.effects, events = of.events;
    if (!of.faults.empty()) faults = &wrong;
    guard = of.guard.value_or(nullptr);
    if (of.delays.first) late = &*of.delays.first;
    if (of.delays.second) bus = &*of.delays.second;
    if (of.monitor) {
      tolerant = (*of.monitor)->settings, fault_settings = &tolerant;
      monitored.weigh((*of.monitor)->robot, (*of.monitor)->known.view());
    }
    weighing = own, monitor_weighing = monitored;
    if (!of.online) return;
    calibrator = &(*of.online)->begin(of.nominal);
    own.weigh(of.nominal, calibrator->knowledge());
    weighing = monitor_weighing = own;
    tolerant.finest = &calibrator->robot;
  }
};

/// One run from rest along any path: a row of each (N, n) array per period, interpolated where the
/// robot slows down.
/// @param error_of  a Python callable (x_d, q_e) -> motor error as the loop's law
nb::tuple Simulation::follow(const Rows& x, const Rows& rate, const Rows& acceleration,
                             const std::optional<nb::callable>& error_of) const {
  const std::size_t periods = x.shape(0) - 1;
  const auto at = [&](std::size_t k) {
    return Setpoint{row<Coordinates>(x, k), row<Coordinates>(rate, k),
                    row<Coordinates>(acceleration, k)};
  };
  const auto path = [&](double k) {
    const auto before = min(std::size_t(k), periods);
    if (before == periods) return at(before);
    return between(nominal.mobility, at(before), at(before + 1), settings.period, k - before);
  };
  Given given(*this);
  if (error_of)
    given.law = [&](const Coordinates& x_d, const Extended& q_e) {
      const nb::gil_scoped_acquire acquire;
      return nb::cast<Joint>((*error_of)(x_d, q_e));
    };
  std::vector<Sample> log;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    Signals signals;
    outcome = Loop(nominal, truth, settings, start, seed, given)
                  .follow(int(periods), steps, path, [&](const Sample& sample) {
                    log.push_back(sample);
                    signals();
                  });
  }
  return answered(outcome, records(log));
}

/// Visits poses in order, keeping friction and backlash. After a failure the robot is placed at the
/// next pose.
nb::object Simulation::visit(const Rows& x_d, double duration, double hold) const {
  std::vector<Visited> visits(x_d.shape(0));
  Given given(*this);
  {
    nb::gil_scoped_release release;
    Signals signals;
    Coordinates from = nominal.home, standing = start;
    std::optional<Loop> loop;
    for (std::size_t i = 0; i < visits.size(); ++i) {
      const Coordinates to = row<Coordinates>(x_d, i);
      const double period = settings.period, end = duration + hold;
      given.began = i * period * std::lround(end / period);
      if (!loop) loop.emplace(nominal, truth, settings, standing, seed + i, given);
      const Outcome outcome =
          loop->move({from, to, duration, hold, steps, 0}, [&](const Sample& sample) {
            signals();
            visits[i].add(nominal, sample, end, hold);
          });
      visits[i].status = outcome.status;
      if (outcome)
        from = standing = to;
      else
        loop.reset();
    }
  }
  return records(visits);
}

/// Poses that close the loops at q, (m, n), and the number of searches that ended at each, (m,).
auto assembly_modes(const Robot& robot, const Joint& q, int starts, std::uint64_t seed) {
  std::vector<Pose> pose = random_starts(robot, q, starts, seed);
  std::vector<char> closed(pose.size());
  for_rows(pose.size(), [&](std::size_t i) { closed[i] = closes(search(robot, q, pose[i])); });
  std::vector<Pose> found;
  for (std::size_t i = 0; i < pose.size(); ++i)
    if (closed[i]) found.push_back(pose[i]);
  const std::vector<AssemblyMode> modes = distinct_modes(robot, std::move(found));
  RowMatrix x(int(modes.size()), dof(robot.mobility));
  std::vector<int> seen;
  for (const AssemblyMode& mode : modes) {
    const Coordinates at = to_coordinates(robot.mobility, mode.pose);
    copy_first(x.cols(), at, x[int(seen.size())]);
    seen.push_back(mode.seen);
  }
  return nb::make_tuple(x, seen);
}
}  // namespace

void bind_simulation(nb::module_& m) {
  nb::class_<FaultyReadings>(m, "FaultyReadings")
      .def(nb::init<const std::vector<Fault>&, double>())
      .def("read", &faulty)
      .def("frozen", &FaultyReadings::frozen);
  nb::class_<Simulation>(m, "Simulation")
      .def(nb::init<const Robot&, const Robot&, const ControlSettings&, Optional<const Known>,
                    const Effects&, Optional<Online>, const std::vector<Fault>&,
                    Optional<const FaultTolerantSetup>, const Lateness&, const std::vector<Event>&,
                    Optional<Guard>, int, const Coordinates&, std::uint64_t>(),
           nb::keep_alive<1, 5>(), nb::keep_alive<1, 7>(), nb::keep_alive<1, 9>(),
           nb::keep_alive<1, 12>())
      .def("follow", &Simulation::follow)
      .def("visit", &Simulation::visit);
  m.def("spoil", &batch_spoil);
  m.def("assembly_modes", &assembly_modes);
}
}  // namespace truepose::python
