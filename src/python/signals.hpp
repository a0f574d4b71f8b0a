// Ctrl-C in a long computation: Python only records it; the main thread's code must check for it.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <chrono>

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
}  // namespace truepose::python
