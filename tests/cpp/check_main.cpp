// Runs the tests of one executable: [--count N] [part of a statement]
#include <cstdlib>
#include <cstring>

#include "check.hpp"

int main(int argc, char** argv) {
  check::State& state = check::state();
  const char* filter = "";
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--count") == 0 && i + 1 < argc) {
      char* end = nullptr;
      state.count = std::strtol(argv[++i], &end, 10);
      if (*end != '\0' || state.count < 1) {
        std::printf("--count wants a number above 0, not \"%s\"\n", argv[i]);
        return 2;
      }
    } else {
      filter = argv[i];
    }
  }
  int ran = 0, failed = 0;
  for (const check::Case& test : state.cases) {
    if (std::strstr(test.statement, filter) == nullptr) continue;
    ++ran;
    state.checks = state.failed = 0;
    state.scene.clear();
    test.run();
    const bool passed = state.failed == 0 && state.checks > 0;
    if (!passed) ++failed;
    std::printf("%s %s (%ld checks%s)\n", passed ? "ok  " : "FAIL", test.statement, state.checks,
                state.checks == 0 ? ": a test must check something" : "");
    if (state.failed > 0) std::printf("     %ld checks failed\n", state.failed);
  }
  if (ran == 0) std::printf("no test's statement contains \"%s\"\n", filter);
  return failed > 0 || ran == 0;
}
