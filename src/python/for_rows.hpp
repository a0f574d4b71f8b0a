// Distribution of a batch's rows over the cores that this process may use; Ctrl-C ends it.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <system_error>
#include <thread>
#include <vector>
#if defined(__linux__)
#include <sched.h>
#endif

#include "python/arrays.hpp"
#include "python/signals.hpp"

namespace truepose::python {
/// A thread's start takes as long as a few hundred rows of kinematics or a few with covariances.
inline constexpr std::size_t kRowsPerThread = 1000, kFewRowsPerThread = 50;

/// Number of cores for this process: fewer than the machine has under taskset or in a container.
inline std::size_t available_cores() {
#if defined(__linux__)
  cpu_set_t cores;
  if (sched_getaffinity(0, sizeof cores, &cores) == 0) return CPU_COUNT(&cores);
#endif
  return std::max(1U, std::thread::hardware_concurrency());
}

/// Calls f(i) for every row i < count on all cores, without the interpreter's lock. Threads take a
/// few rows at a time. f writes to row i only, so results do not depend on the number of threads.
/// @throws nb::python_error  a signal's handler raised; rows are then missing
template <class F>
void for_rows(std::size_t count, F&& f, std::size_t rows_per_thread = kRowsPerThread) {
  const nb::gil_scoped_release release;
  const std::size_t threads = std::min(available_cores(), count / rows_per_thread);
  const std::size_t few = std::max<std::size_t>(1, rows_per_thread / 16);
  std::atomic<std::size_t> next = 0;
  const auto work = [&](auto&& between) {
    for (std::size_t start; (start = next.fetch_add(few)) < count;) {
      for (std::size_t i = start; i < std::min(start + few, count); ++i) f(i);
      between();
    }
  };
  std::vector<std::thread> others;
  others.reserve(threads);
  while (others.size() + 1 < threads) try {
      others.emplace_back(work, [] {});
    } catch (const std::system_error&) {  // without a further thread the existing ones do the work
      break;
    }
  std::exception_ptr stopped;
  try {
    work(Signals{});
  } catch (...) {
    stopped = std::current_exception();
    next = count;
  }
  for (std::thread& other : others) other.join();
  if (stopped) std::rethrow_exception(stopped);
}

/// The same in order, for rows that depend on the preceding ones.
template <class F>
void for_rows_in_order(std::size_t count, F&& f) {
  const nb::gil_scoped_release release;
  Signals signals;
  for (std::size_t i = 0; i < count; ++i) {
    f(i);
    signals();
  }
}

/// Work space of this thread, reused from row to row.
inline std::vector<double>& scratch(std::size_t size) {
  thread_local std::vector<double> work;
  if (work.size() < size) work.resize(size);
  return work;
}

/// Writes the used part of a matrix of fixed capacity.
template <class M>
void write(const M& matrix, std::size_t rows, std::size_t columns, double* out) {
  for (std::size_t i = 0; i < rows; ++i) out = std::copy_n(matrix[i].begin(), columns, out);
}

/// Calls f(i, out) for each row i < count, out[m] the row of the m-th array, and collects the
/// arrays, each of a row's `shapes`, and the outcomes. Without an answer a row is NaN.
template <std::size_t M, class F>
nb::tuple batch(std::size_t count, const Shape (&shapes)[M], F&& f,
                std::size_t rows_per_thread = kRowsPerThread) {
  std::vector<Owned<double>> arrays;
  for (Shape shape : shapes) {
    shape.insert(shape.begin(), count);
    arrays.emplace_back(shape);
  }
  Outcomes outcomes(count);
  for_rows(
      count,
      [&](std::size_t i) {
        std::array<double*, M> out;
        for (std::size_t m = 0; m < M; ++m) out[m] = arrays[m][i];
        const Outcome outcome = f(i, out);
        outcomes.set(i, outcome);
        for (std::size_t m = 0; m < M && !outcome; ++m) std::fill_n(out[m], arrays[m].width, NAN);
      },
      rows_per_thread);
  nb::list result;
  for (Owned<double>& array : arrays) result.append(array.release());
  result.append(outcomes.status.release());
  result.append(outcomes.chain.release());
  return nb::tuple(result);
}

/// The same for one array of one vector per row of `in`, by f(x, out, i).
template <class In, class Out, class F>
nb::tuple map_rows(const Rows& in, std::size_t n_out, F&& f) {
  return batch(in.shape(0), {{n_out}}, [&](std::size_t i, auto& out) {
    Out values{};
    const Outcome outcome = f(row<In>(in, i), values, i);
    std::copy_n(values.data(), n_out, out[0]);
    return outcome;
  });
}
}  // namespace truepose::python
