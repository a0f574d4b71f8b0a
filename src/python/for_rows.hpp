// Distribution of a batch's rows over the cores that this process may use; Ctrl-C ends it.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <limits>

#include "python/arrays.hpp"

namespace truepose::python {
/// Number of threads that wait for the others to stop at once.
inline std::atomic<int> stopping = 0;

/// Checks for signals every kPatience, and always for a request to stop: the main thread, the only
/// one to receive signals, may wait for this one. Call it often, from the thread that Python
/// called, with or without the interpreter's lock: usually it only reads a clock, in about 25 ns.
class Signals {
 public:
  /// @throws nanobind::python_error  the error of the signal's handler, or KeyboardInterrupt
  void operator()() {
    if (stopping.load(std::memory_order_relaxed) > 0) {
      const nanobind::gil_scoped_acquire acquire;
      PyErr_SetNone(PyExc_KeyboardInterrupt);
      throw nanobind::python_error();
    }
    const Clock::time_point now = Clock::now();
    if (now < next_) return;
    next_ = now + kPatience;
    const nanobind::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw nanobind::python_error();
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kPatience{50};
  Clock::time_point next_ = Clock::now() + kPatience;
};

/// A thread's start takes as long as a few hundred rows of kinematics or a few with covariances.
inline constexpr std::size_t kRowsPerThread = 1000, kFewRowsPerThread = 50;
/// For rows that depend on the preceding ones: no other thread starts.
inline constexpr std::size_t kInOrder = std::numeric_limits<std::size_t>::max();

/// Calls f(i) for every row i < count on all cores, without the interpreter's lock. Threads take a
/// few rows at a time. f writes to row i only, so results do not depend on the number of threads.
/// @throws nb::python_error  a signal's handler raised; rows are then missing
void for_rows(std::size_t count, const std::function<void(std::size_t)>& f,
              std::size_t rows_per_thread = kRowsPerThread);

/// Work space of this thread, reused from row to row.
inline std::vector<double>& scratch(std::size_t size) {
  thread_local std::vector<double> work;
  if (work.size() < size) work.resize(size);
  return work;
}

/// A row's place in each result.
using Results = std::array<double*, 8>;

/// Calls f(i, out) for each row i < count, out[m] the row of the m-th array, and collects the
/// arrays, each of a row's `shapes`, and the outcomes. Without an answer a row is NaN.
nb::tuple batch(std::size_t count, const std::vector<Shape>& shapes,
                const std::function<Outcome(std::size_t, const Results&)>& f,
                std::size_t rows_per_thread = kRowsPerThread);
}  // namespace truepose::python
