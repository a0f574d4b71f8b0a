// Distribution of a batch's rows over the cores that this process may use; Ctrl-C ends it.
#pragma once

#include <functional>
#include <vector>

#include "python/arrays.hpp"
#include "python/signals.hpp"

namespace truepose::python {
/// A thread's start takes as long as a few hundred rows of kinematics or a few with covariances.
inline constexpr std::size_t kRowsPerThread = 1000, kFewRowsPerThread = 50;

/// Calls f(i) for every row i < count on all cores, without the interpreter's lock. Threads take a
/// few rows at a time. f writes to row i only, so results do not depend on the number of threads.
/// @throws nb::python_error  a signal's handler raised; rows are then missing
void for_rows(std::size_t count, const std::function<void(std::size_t)>& f,
              std::size_t rows_per_thread = kRowsPerThread);

/// The same in order, for rows that depend on the preceding ones.
void for_rows_in_order(std::size_t count, const std::function<void(std::size_t)>& f);

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
nb::tuple batch(std::size_t count, const std::vector<Shape>& shapes,
                const std::function<Outcome(std::size_t, const std::vector<double*>&)>& f,
                std::size_t rows_per_thread = kRowsPerThread);
}  // namespace truepose::python
