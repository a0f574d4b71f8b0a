// Time of one call: repeats, their median and minimum, a table or JSON.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

namespace bench {

struct Row {
  std::string name;
  double median, minimum;  ///< seconds per call
};

/// Keeps the compiler from leaving out work whose result nobody reads.
template <class T>
inline void keep(const T& value) {
  asm volatile("" : : "r"(&value) : "memory");
}

/// Times f(i), i = 0 … calls-1, `repeats` times over, after one round to warm up.
template <class F>
Row measure(const std::string& name, int calls, int repeats, F&& f) {
  std::vector<double> seconds;
  for (int repeat = -1; repeat < repeats; ++repeat) {
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < calls; ++i) f(i);
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    if (repeat >= 0) seconds.push_back(taken.count() / calls);
  }
  std::sort(seconds.begin(), seconds.end());
  return {name, seconds[seconds.size() / 2], seconds.front()};
}

inline void print_table(const std::vector<Row>& rows) {
  std::printf("%-52s %12s %12s\n", "one call of", "median", "minimum");
  const auto readable = [](double seconds) {
    char text[40];
    if (seconds < 1e-5)
      std::snprintf(text, sizeof text, "%.3f µs", seconds * 1e6);
    else
      std::snprintf(text, sizeof text, "%.3f ms", seconds * 1e3);
    return std::string(text);
  };
  for (const Row& row : rows)
    std::printf("%-52s %12s %12s\n", row.name.c_str(), readable(row.median).c_str(),
                readable(row.minimum).c_str());
}

inline void print_json(const std::vector<Row>& rows) {
  std::printf("[");
  for (std::size_t i = 0; i < rows.size(); ++i)
    std::printf("%s\n  {\"name\": \"%s\", \"median_s\": %.4g, \"minimum_s\": %.4g}",
                i == 0 ? "" : ",", rows[i].name.c_str(), rows[i].median, rows[i].minimum);
  std::printf("\n]\n");
}

}  // namespace bench
