// Distribution of a batch's rows over the cores that this process may use; Ctrl-C ends it.
#include "python/for_rows.hpp"

#include <future>
#include <system_error>
#include <thread>
#if defined(__linux__)
#include <sched.h>
#endif

namespace truepose::python {
namespace {
/// Number of cores for this process: fewer than the machine has under taskset or in a container.
std::size_t available_cores() {
#if defined(__linux__)
  cpu_set_t cores;
  if (sched_getaffinity(0, sizeof cores, &cores) == 0) return CPU_COUNT(&cores);
#endif
  return max(1U, std::thread::hardware_concurrency());
}
}  // namespace

void for_rows(std::size_t count, const std::function<void(std::size_t)>& f,
              std::size_t rows_per_thread) {
  const nb::gil_scoped_release release;
  const std::size_t threads = min(available_cores(), count / rows_per_thread);
  const std::size_t few = clamp<std::size_t>(rows_per_thread / 16, 1, kRowsPerThread / 16);
  std::atomic<std::size_t> next = 0;
  const auto work = [&](auto between) {
    for (std::size_t start; (start = next.fetch_add(few)) < count;) {
      for (std::size_t i = start; i < min(start + few, count); ++i) f(i);
      between();
    }
  };
  std::vector<std::future<void>> others;  // whose end waits for theirs
  try {
    while (others.size() + 1 < threads)
      others.push_back(std::async(std::launch::async, work, [] {}));
  } catch (const std::system_error&) {  // without a further thread the existing ones do the work
  }
  try {
    work(Signals{});
  } catch (...) {
    next = count;
    throw;
  }
  for (std::future<void>& other : others) other.get();
}

nb::tuple batch(std::size_t count, const std::vector<Shape>& shapes,
                const std::function<Outcome(std::size_t, const Results&)>& f,
                std::size_t rows_per_thread) {
  std::vector<Owned<double>> arrays;
  for (Shape shape : shapes) {
    shape.insert(shape.begin(), count);
    arrays.emplace_back(shape);
  }
  Owned<int> status({count}), chain({count});
  for_rows(
      count,
      [&](std::size_t i) {
        Results out;
        for (std::size_t m = 0; m < arrays.size(); ++m) out[m] = arrays[m][i];
        const Outcome outcome = f(i, out);
        *status[i] = int(outcome.status), *chain[i] = outcome.chain;
        for (std::size_t m = 0; m < arrays.size() && !outcome; ++m)
          std::fill_n(out[m], arrays[m].width, NAN);
      },
      rows_per_thread);
  nb::list result;
  for (Owned<double>& array : arrays) result.append(array.release());
  result.append(status.release()), result.append(chain.release());
  return nb::tuple(result);
}
}  // namespace truepose::python
