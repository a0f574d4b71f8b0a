// Simulations for Python: runs or visits of poses, with effects, faults, multirate sensors.
#include "simulation/simulate.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"
#include "python/structs.hpp"
#include "simulation/assembly.hpp"

namespace truepose::python {
namespace {
/// Readings, (N, n + r), each as `change` makes them, in sequence.
nb::object changed(const Rows& q_e,
                   const std::function<void(std::size_t i, Extended& now)>& change) {
  const std::size_t width = q_e.shape(1);
  const auto next = [&](std::size_t i, auto& out) {
    Extended now = row<Extended>(q_e, i);
    change(i, now);
    std::copy_n(now.begin(), width, out[0]);
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

/// One simulated run, or visits of poses: what the loop needs, and what its extras point to.
class Simulation {
 public:
  Simulation(const Robot& believed, const Robot& real, const ControlSettings& control,
             Optional<const Known> known, const Effects& effects, Optional<Online> online,
             const std::vector<Fault>& faults, Optional<const FaultTolerantSetup> monitor,
             const Lateness& delays, const std::vector<Event>& events, Optional<Guard> guard,
             int steps, const Coordinates& start, std::uint64_t seed)
      : nominal_(believed),
        truth_(real),
        settings_(control),
        delays_(delays),
        weights_(nominal_, known.value_or(nullptr)),
        monitor_weights_(monitor ? (*monitor)->robot : nominal_,
                         monitor ? &(*monitor)->known : nullptr),
        faults_(faults, control.period, seed),
        steps_(steps),
        start_(start),
        seed_(seed) {
    extras_.weighing = weights_, extras_.monitor_weighing = monitor_weights_;
    extras_.effects = effects, extras_.events = events;
    if (!faults.empty()) extras_.faults = &faults_;
    extras_.guard = guard.value_or(nullptr);
    if (delays_.first) extras_.late = &*delays_.first;
    if (delays_.second) extras_.bus = &*delays_.second;
    if (monitor) {
      fault_settings_ = (*monitor)->settings;
      extras_.fault_settings = &fault_settings_;
    }
    if (!online) return;
    OnlineCalibrator& learner = (*online)->begin(nominal_);
    extras_.learner = &learner;
    weights_.weigh(nominal_, learner.knowledge());
    extras_.weighing = extras_.monitor_weighing = weights_;
    fault_settings_.finest = &learner.robot;
  }

  using OwnError = std::optional<nb::callable>;
  nb::tuple follow(const Rows& x, const Rows& rate, const Rows& acceleration,
                   const OwnError& error_of);
  nb::object visit(const Rows& x_d, double duration, double hold);

 private:
  const Robot nominal_, truth_;
  const ControlSettings settings_;
  const Lateness delays_;
  Weights weights_, monitor_weights_;
  FaultyReadings faults_;
  FaultTolerantSettings fault_settings_;
  Extras extras_;
  const int steps_;
  const Coordinates start_;
  const std::uint64_t seed_;
};

/// One run from rest along any path: a row of each (N, n) array per period, interpolated where the
/// robot slows down.
/// @param error_of  a Python callable (x_d, q_e) -> motor error as the loop's law
nb::tuple Simulation::follow(const Rows& x, const Rows& rate, const Rows& acceleration,
                             const OwnError& error_of) {
  const std::size_t periods = x.shape(0) - 1;
  const auto at = [&](std::size_t k) {
    return Setpoint{row<Coordinates>(x, k), row<Coordinates>(rate, k),
                    row<Coordinates>(acceleration, k)};
  };
  const auto path = [&](double k) {
    const auto before = std::min(static_cast<std::size_t>(k), periods);
    if (before == periods) return at(before);
    return between(nominal_.mobility, at(before), at(before + 1), settings_.period,
                   k - static_cast<double>(before));
  };
  if (error_of)
    extras_.law = [&](const Coordinates& x_d, const Extended& q_e) {
      const nb::gil_scoped_acquire acquire;
      return nb::cast<Joint>((*error_of)(x_d, q_e));
    };
  std::vector<Sample> log;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    Signals signals;
    Loop loop(nominal_, truth_, settings_, start_, seed_, extras_);
    outcome = loop.follow(static_cast<int>(periods), steps_, path, [&](const Sample& sample) {
      log.push_back(sample);
      signals();
    });
  }
  return answered(
      outcome,
      records(log, TRUEPOSE_MEMBERS(Sample, time, x_d, x, q_e, error, torque, status, gave_up,
                                    health, symptom, stops, brakes, disturbance, disturbed, size,
                                    force, refused, warm, safety, cause, part)));
}

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
    const bool moving = sample.time <= end - std::min(kRest, hold);
    for (int k = 0; k < dof(nominal.mobility); ++k) {
      low[k] = moving ? x[k] : std::min(low[k], x[k]);
      high[k] = moving ? x[k] : std::max(high[k], x[k]);
    }
    for (int k = 0; k < nominal.motors; ++k) {
      const double limit = nominal.chain[k].torque_limit;
      if (saturated < 0 && limit > 0 && std::fabs(sample.torque[k]) >= limit) saturated = k;
    }
  }
};

/// Visits poses in order, keeping friction and backlash. After a failure the robot is placed at the
/// next pose.
nb::object Simulation::visit(const Rows& x_d, double duration, double hold) {
  std::vector<Visited> visits(x_d.shape(0));
  {
    nb::gil_scoped_release release;
    Signals signals;
    Coordinates from = nominal_.home, standing = start_;
    std::optional<Loop> loop;
    for (std::size_t i = 0; i < visits.size(); ++i) {
      const Coordinates to = row<Coordinates>(x_d, i);
      const double period = settings_.period, end = duration + hold;
      extras_.began = i * period * std::lround(end / period);
      if (!loop) loop.emplace(nominal_, truth_, settings_, standing, seed_ + i, extras_);
      const Outcome outcome =
          loop->move({from, to, duration, hold, steps_, 0}, [&](const Sample& sample) {
            signals();
            visits[i].add(nominal_, sample, end, hold);
          });
      visits[i].status = outcome.status;
      if (outcome)
        from = standing = to;
      else
        loop.reset();
    }
  }
  return records(
      visits, TRUEPOSE_MEMBERS(Visited, x, q_e, low, high, saturated, status, unanswered, reason));
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
  RowMatrix x(static_cast<int>(modes.size()), dof(robot.mobility));
  std::vector<int> seen;
  for (const AssemblyMode& mode : modes) {
    const Coordinates at = to_coordinates(robot.mobility, mode.pose);
    std::copy_n(at.begin(), x.cols(), x[static_cast<int>(seen.size())]);
    seen.push_back(mode.seen);
  }
  return nb::make_tuple(x, seen);
}

/// Exact readings of a mechanism at this pose with these motors and arms.
auto readings(const Robot& robot, const Frame& frame, const std::array<double, kMaxBars>& psi,
              double theta, const Joint& motor, const Joint& arm) {
  FullPose pose;
  pose.D = frame.t, pose.R = frame.R, pose.psi = psi, pose.theta = theta;
  Extended q_e{};
  const Outcome outcome = read_standing(robot, pose, motor, arm, q_e);
  return nb::make_tuple(q_e, static_cast<int>(outcome.status));
}
}  // namespace

void bind_simulation(nb::module_& m) {
  nb::class_<Slow>(m, "Slow").def(nb::init<const Lateness&>()).def("deliver", &Slow::deliver);
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
  m.def("readings", &readings);
}
}  // namespace truepose::python
