// A broken promise of the core in a fuzz target. It ends the process.
#pragma once

#include <cstdio>
#include <cstdlib>

namespace fuzz {

inline const char* scene = "";  ///< which input is running, where the driver knows it

inline void require(bool holds, const char* promise) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s (%s)\n", promise, scene);
  std::abort();
}

}  // namespace fuzz
