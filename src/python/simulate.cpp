// Simulations for Python: runs or visits of poses, with effects, faults, multirate sensors.
#include "simulation/simulate.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"
#include "python/structs.hpp"
#include "simulation/assembly.hpp"

namespace truepose::c {
TRUEPOSE_MEMBERS(Sample, time, x_d, x, q_e, error, status, gave_up, health, symptom, stops,
                 disturbance, refused, machine)
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

/// A true robot under a controller, as Python gives them, which runs along one path after another.
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
  Coordinates start;  ///< of the next loop
  std::uint64_t seed;
  std::optional<nb::callable> error_of;  ///< (x_d, q_e) -> motor error, as the law

  Weights own{nominal, known.value_or(nullptr)}, monitored{nominal, nullptr};
  FaultyReadings wrong{faults, settings.period, seed};
  FaultTolerantSettings tolerant{};
  Extras extras = pointers();
  std::optional<Loop> loop{};

  /// Inputs of a loop.
  Extras pointers();
  /// The loop, a new one at the beginning and after a failure.
  Loop& running() {
    return loop ? *loop : loop.emplace(nominal, truth, settings, start, seed, extras);
  }

  nb::tuple follow(const Rows& x, const Rows& rate, const Rows& acceleration);
  /// Whether the guard, of a robot at rest, waits before a cycle.
  bool starts(int cycle) {
    running();
    return (*guard)->begins(cycle);
  }
  /// One cycle of a quintic move of another simulator's robot. @param q_e  at the sensors
  int step(const Coordinates& from, const Coordinates& to, double duration, double time,
           const Extended& q_e, bool frozen) {
    const Setpoint setpoint = quintic(nominal.mobility, from, to, duration, time);
    return int(running().step(setpoint, q_e, frozen));
  }
};

Extras Simulation::pointers() {
  Extras given{.weighing = own, .effects = effects, .events = events};
  if (!faults.empty()) given.faults = &wrong;
  given.guard = guard.value_or(nullptr);
  if (delays.first) given.late = &*delays.first;
  if (delays.second) given.bus = &*delays.second;
  if (monitor) {
    tolerant = (*monitor)->settings, given.fault_settings = &tolerant;
    monitored.weigh((*monitor)->robot, (*monitor)->known.view());
  }
  given.monitor_weighing = monitored;
  if (error_of)
    given.law = [this](const Coordinates& x_d, const Extended& q_e) {
      const nb::gil_scoped_acquire acquire;
      return nb::cast<Joint>((*error_of)(x_d, q_e));
    };
  if (!online) return given;
  given.calibrator = &(*online)->begin(nominal);
  own.weigh(nominal, given.calibrator->knowledge());
  given.weighing = given.monitor_weighing = own;
  tolerant.finest = &given.calibrator->robot;
  return given;
}

/// Runs along any path from rest, keeping friction and backlash: a row of each (N, n) array per
/// period, interpolated where the robot slows down. After a failure the next run starts at the end
/// of the last one that arrived.
nb::tuple Simulation::follow(const Rows& x, const Rows& rate, const Rows& acceleration) {
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
  std::vector<Sample> log;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    Signals signals;
    outcome = running().follow(int(periods), steps, path, [&](const Sample& sample) {
      log.push_back(sample);
      signals();
    });
  }
  extras.began += periods * settings.period;
  ++seed;
  if (outcome)
    start = at(periods).x;
  else
    loop.reset();
  return answered(outcome, records(log));
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
                    Optional<Guard>, int, const Coordinates&, std::uint64_t,
                    std::optional<nb::callable>>(),
           nb::keep_alive<1, 5>(), nb::keep_alive<1, 7>(), nb::keep_alive<1, 9>(),
           nb::keep_alive<1, 12>())
      .def("follow", &Simulation::follow)
      .def("step", &Simulation::step)
      .def("starts", &Simulation::starts)
      .def("begin", [](Simulation& own) { own.running().clock = {}; })
      .def_prop_ro("time", [](Simulation& own) { return own.running().clock.time; })
      .def_prop_ro("report", [](Simulation& own) { return own.running().report(); });
  m.def("spoil", &batch_spoil);
  m.def("assembly_modes", &assembly_modes);
}
}  // namespace truepose::python
