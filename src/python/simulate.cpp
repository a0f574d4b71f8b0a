// Simulations for Python: runs or visits of poses, with effects, faults, multirate sensors.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <vector>

#include "python/arrays.hpp"
#include "python/fault_tolerant_setup.hpp"
#include "python/for_rows.hpp"
#include "python/known.hpp"
#include "python/multirate.hpp"
#include "python/online_calibration.hpp"
#include "python/structs.hpp"
#include "simulation/assembly.hpp"
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
auto run_visit(const Setup& of, const Rows& x_d, double duration, double hold, int steps,
               const Coordinates& start, std::uint64_t seed) {
  std::vector<Visited> visits(x_d.shape(0));
  {
    nb::gil_scoped_release release;
    Signals signals;
    LoopExtras with(of, seed);
    Coordinates from = of.nominal.home, standing = start;
    std::optional<Loop> loop;
    for (std::size_t i = 0; i < visits.size(); ++i) {
      const Coordinates to = row<Coordinates>(x_d, i);
      const double period = of.settings.period, end = duration + hold;
      with.extras.began = i * period * std::lround(end / period);
      if (!loop) loop.emplace(of.nominal, of.truth, of.settings, standing, seed + i, with.extras);
      const Outcome outcome =
          loop->move({from, to, duration, hold, steps, 0}, [&](const Sample& sample) {
            signals();
            visits[i].add(of.nominal, sample, end, hold);
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

/// Poses that close the loops at q, (m, n), and the number of searches that ended at each, (m,).
auto assembly_modes(const Robot& robot, const Joint& q, int starts, std::uint64_t seed) {
  std::vector<Pose> pose = random_starts(robot, q, starts, seed);
  std::vector<char> closed(pose.size());
  for_rows(pose.size(), [&](std::size_t i) { closed[i] = closes(search(robot, q, pose[i])); });
  std::vector<Pose> found;
  for (std::size_t i = 0; i < pose.size(); ++i)
    if (closed[i]) found.push_back(pose[i]);
  const std::vector<AssemblyMode> modes = distinct_modes(robot, std::move(found));
  const std::size_t n = dof(robot.mobility), count = modes.size();
  Owned<double> x({count, n});
  Owned<int> seen({count});
  for (std::size_t k = 0; k < count; ++k) {
    std::copy_n(to_coordinates(robot.mobility, modes[k].pose).begin(), n, x[k]);
    *seen[k] = modes[k].seen;
  }
  return together(x, seen);
}

/// J_x at home for every rod, (rods, freedoms); requires robot.full.
auto full_rod_rows(const Robot& robot) {
  const std::size_t rods = robot.full.rods, unknowns = robot.full.unknowns;
  Owned<double> result({rods, unknowns});
  std::array<engine::Row, engine::kClosures> rows;
  const Outcome outcome = full_rows(robot, rows);
  if (!outcome) throw nb::value_error(describe(outcome.status));
  for (std::size_t rod = 0; rod < rods; ++rod)
    std::memcpy(result[rod], rows[rod].data(), unknowns * sizeof(double));
  return result.release();
}

/// Exact readings of a mechanism at this pose with these motors and arms.
auto readings(const Robot& robot, const std::array<double, 3>& D, const std::array<double, 9>& R,
              const std::array<double, kMaxBars>& psi, double theta, const Joint& motor,
              const Joint& arm) {
  FullPose pose;
  std::copy_n(D.begin(), 3, pose.D.data());
  for (int k = 0; k < 9; ++k) pose.R(k / 3, k % 3) = R[k];
  pose.psi = psi, pose.theta = theta;
  Extended q_e{};
  const Outcome outcome = read_standing(robot, pose, motor, arm, q_e);
  return nb::make_tuple(q_e, static_cast<int>(outcome.status));
}

}  // namespace

void bind_simulation(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<Slow>(m, "Slow")
      .def(nb::init<const Lateness&>())
      .def("deliver", &Slow::deliver, "motors"_a, "q_e"_a);
  nb::class_<FaultyReadings>(m, "FaultyReadings")
      .def(nb::init<const std::vector<Fault>&, double>())
      .def("read", &faulty)
      .def("frozen", &FaultyReadings::frozen);
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
  m.def("assembly_modes", &assembly_modes);
  m.def("full_rod_rows", &full_rod_rows);
  m.def("readings", &readings);
}
}  // namespace truepose::python
