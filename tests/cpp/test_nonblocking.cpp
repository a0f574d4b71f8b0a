// The loops of test_realtime.cpp under clang's RealtimeSanitizer and function effects.
#define TRUEPOSE_NONBLOCKING
#include "control_path.hpp"  // all its .cpp files

#include "test_realtime.cpp"

#include "../../packages/safety/tests/cpp/test_safety_realtime.cpp"
