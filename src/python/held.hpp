// Arrays and states that Python holds for the core, which has pointers to them.
#pragma once

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <span>
#include <stdexcept>

#include "calibration/line.hpp"
#include "control/fault_tolerant_control.hpp"
#include "estimation/online_calibrator.hpp"
#include "python/arrays.hpp"

namespace truepose::python {
/// A Python object, or None.
template <class T>
using Optional = std::optional<T*>;

/// Knowledge of a robot.
struct Known {
  std::vector<int> column;
  RowMatrix root;
  Extended sigma;

  Known(const std::vector<int>& columns, const RowMatrix& lower, const Extended& sigmas)
      : column(columns), root(lower), sigma(sigmas) {
    if (root.rows() != root.cols() || root.rows() != count())
      throw std::invalid_argument("one row and column for each parameter");
  }
  int count() const { return int(column.size()); }
  Knowledge view() const { return {count(), column.data(), root.data(), sigma}; }
};

/// Influences at pose i: none, or row i of (N, (m + r) × count).
inline Influences influences_at(const Robot& robot, const std::optional<Rows>& influence,
                                std::size_t i) {
  if (!influence) return {};
  return {int(influence->shape(1)) / readings(robot), at_row(*influence, i)};
}

/// Knowledge and work space of one thread for weighted laws; none without knowledge.
class Weights : public Weighing {
 public:
  Weights(const Robot& robot, const Known* of) {
    if (of) weigh(robot, of->view());
  }
  void weigh(const Robot& robot, const Knowledge& by) {
    knowledge_ = by;
    space_.resize(estimate_work(robot, by.count));
    known = &knowledge_, work = space_.data();
  }
  Weights(const Weights&) = delete;
  Weights& operator=(const Weights&) = delete;

 private:
  Knowledge knowledge_;
  std::vector<double> space_;
};

using Delays = std::optional<MultirateSettings>;

/// Delayed sensors as the controller models them, and the true ones.
using Lateness = std::pair<Delays, Delays>;

/// Settings of the fault monitor: the robot at its highest level, and the knowledge of it.
struct FaultTolerantSetup {
  Robot robot;
  Known known;
  FaultTolerantSettings settings;
  Delays late;

  FaultTolerantSetup(const Robot& monitored, const Known& knowledge,
                     const FaultMonitorSettings& monitor, Optional<Supervisor> supervisor,
                     const Delays& slow, Optional<const SafetyLimits> limits)
      : robot(monitored),
        known(knowledge),
        settings{monitor, &robot, supervisor.value_or(nullptr)},
        late(slow) {
    prepare(settings.monitor);
    if (limits) settings.limits = **limits;
    settings.limited = limits.has_value();
  }
  FaultTolerantSetup(const FaultTolerantSetup&) = delete;
  FaultTolerantSetup& operator=(const FaultTolerantSetup&) = delete;
};

/// An online calibrator, the arrays that it points to, and their level; kept between runs.
struct Online : OnlineCalibrator {
  const Robot nominal;
  const Known prior;
  const Level level;
  const RowMatrix drifts, steps;
  const std::vector<double> log_odds;
  const std::vector<int> ends;
  std::vector<double> space, followed;
  Window window;
  std::vector<Recognised> recognised;

  /// @param drift  one row per random walk, one column per uncertain parameter
  /// @param step  one row per change, of each change the log odds, and the end of its steps
  Online(const Robot& of, const Known& known, const std::vector<double>& mean,
         const RowMatrix& drift, double gate, bool full, const RowMatrix& step,
         const std::vector<int>& end, const std::vector<double>& odds, int load,
         const Coordinates& force, const Joint& compliance)
      : nominal(of),
        prior(known),
        level(python::level(full)),
        drifts(drift),
        steps(step),
        log_odds(odds),
        ends(end),
        space(online_memory(of, known.count())) {
    static_cast<void>(start(nominal, prior.view(), space.data(), *this));
    if (mean.size() != width()) throw std::invalid_argument("mean: one number a parameter");
    std::ranges::copy(mean, state.xi);
    state.kept.assign(state);
    settings.gate = gate;
    settings.changes = {steps.rows(), int(ends.size()), drifts.rows(), load,  steps.data(),
                        ends.data(),  log_odds.data(),  drifts.data(), force, compliance};
    if (ends.empty()) return;
    followed.resize(follow_memory(*this, settings.changes));
    follow(settings.changes, followed.data(), window, *this);
  }
  Online(const Online&) = delete;
  Online& operator=(const Online&) = delete;

  std::size_t width() const { return parameter_count(nominal); }
  std::span<double> kept() const { return {state.kept.xi, width() + state.count * state.count}; }

  /// The calibrator for a run: with the robot at ξ̂. Its first row is new.
  OnlineCalibrator& begin(const Robot& of) {
    if (!replaying(*this)) settings.linearised = nullptr;
    robot = of;
    robot.level = nominal.level;
    static_cast<void>(set_parameters(nominal, state.xi, robot));
    pose = to_pose(of.mobility, of.home);
    last.fill(INFINITY);
    if (in_use) std::copy_n(state.xi, width(), in_use);
    return *this;
  }
  /// One row of a log, whatever it was before: also once updates have stopped.
  Outcome observe(const Extended& q_e) {
    if (!state.window) {
      const Outcome outcome = truepose::observe(level, *this, q_e);
      ++(outcome.status == Status::ok ? lines : left_out);
      return outcome;
    }
    const Real usual = std::exchange(fresh, -1);
    Outcome outcome = calibrate_online(level, *this, q_e);
    fresh = INFINITY;  // the same row again: those that wait are processed
    while (replaying(*this)) outcome = calibrate_online(level, *this, q_e);
    fresh = usual;
    note();
    return outcome;
  }
  /// Keeps the changes recognised since the last call.
  void note() {
    for (auto k = long(recognised.size()); k < window.recognised; ++k)
      recognised.push_back(window.news[k % kNews]);
  }
  /// State other than ξ̂ and its root, each part as bytes: the rollback state, the window's rows,
  /// counts, σ, the residual test, the window, and the changes recognised.
  auto parts() {
    const auto bytes = [](auto&& of) { return std::as_writable_bytes(std::span(of)); };
    const auto one = [](auto& of) { return std::as_writable_bytes(std::span(&of, 1)); };
    return std::array{bytes(kept()),   bytes(followed), one(state.due),
                      one(lines),      one(left_out),   one(state.sigma),
                      one(state.test), one(window),     bytes(recognised)};
  }
  nb::list memory() {
    nb::list saved;
    for (const auto& part : parts()) saved.append(nb::bytes(part.data(), part.size()));
    return saved;
  }
  /// Resumes from another object's arrays and memory.
  void resume(const std::vector<nb::bytes>& saved) {
    if (saved.size() != parts().size()) throw std::invalid_argument("the memory of another filter");
    recognised.resize(saved.back().size() / sizeof recognised[0]);
    for (std::size_t k = 0; const auto& part : parts()) {
      if (saved[k].size() != part.size())
        throw std::invalid_argument("the memory of another filter");
      std::memcpy(part.data(), saved[k++].data(), part.size());
    }
    if (state.window) lay_out(nominal, state, settings.changes, followed.data() + width(), window);
  }
};
}  // namespace truepose::python
