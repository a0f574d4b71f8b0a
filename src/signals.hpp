// Ctrl-C in a long computation. Python only notes a signal; whoever holds up the main
// thread must ask for it.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <chrono>

namespace truepose::python {

/// How many threads wait for the others to end their work at once.
inline std::atomic<int> stopping = 0;

/// Asks for signals every kPatience, and always whether the work shall end: the main thread, which
/// alone hears signals, may wait for this one. Call it often, from the thread that Python called,
/// with or without the interpreter's lock: mostly it only reads a clock, in some 25 ns.
class Signals {
 public:
  /// @throws nanobind::python_error  what the signal's handler raised, or KeyboardInterrupt
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
