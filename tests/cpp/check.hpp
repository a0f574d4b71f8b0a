// A small test framework: statements, checks, counts.
//
// A test states something about robots: TEST("the forward model undoes the inverse one") {...}.
// A test that checks nothing fails, and so does a name filter that selects nothing.
#pragma once

#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

namespace check {

struct Case {
  const char* statement;
  void (*run)();
};

struct State {
  std::vector<Case> cases;
  std::string scene;            ///< what the running checks are about, e.g. the mechanism's name
  long count = 0;               ///< --count N, 0: the test's own size
  long checks = 0, failed = 0;  ///< of the running test
};
inline State& state() {
  static State instance;
  return instance;
}

/// Size of a bulk sample: the test's own, or what --count asks for.
inline long sample_size(long otherwise) { return state().count > 0 ? state().count : otherwise; }

struct Register {
  Register(const char* statement, void (*run)()) { state().cases.push_back({statement, run}); }
};

inline void report(bool passed, const char* file, int line, const char* what) {
  ++state().checks;
  if (passed || ++state().failed > 10) return;  // ten lines say enough
  std::printf("  %s:%d: [%s] %s\n", file, line, state().scene.c_str(), what);
}

inline void near(double a, double b, double tolerance, const char* file, int line,
                 const char* what) {
  const bool passed = std::fabs(a - b) <= tolerance;  // false for a NaN
  char text[400] = "";
  if (!passed)
    std::snprintf(text, sizeof text, "%s: %.17g and %.17g differ by %.3g > %.3g", what, a, b,
                  std::fabs(a - b), tolerance);
  report(passed, file, line, text);
}

/// Seeded random numbers in [-1, 1].
class Random {
 public:
  explicit Random(unsigned seed) : generator_(seed) {}
  double operator()() { return uniform_(generator_); }

 private:
  std::mt19937_64 generator_;
  std::uniform_real_distribution<double> uniform_{-1, 1};
};

}  // namespace check

#define CHECK_JOIN2(a, b) a##b
#define CHECK_JOIN(a, b) CHECK_JOIN2(a, b)
#define TEST(statement)                                                                  \
  static void CHECK_JOIN(test_, __LINE__)();                                             \
  static const check::Register CHECK_JOIN(case_, __LINE__)(statement,                    \
                                                           CHECK_JOIN(test_, __LINE__)); \
  static void CHECK_JOIN(test_, __LINE__)()
#define CHECK(condition) check::report(static_cast<bool>(condition), __FILE__, __LINE__, #condition)
#define CHECK_NEAR(a, b, tolerance) check::near(a, b, tolerance, __FILE__, __LINE__, #a " ~ " #b)
