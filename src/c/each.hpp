// A loop of the preprocessor, for lists of members.
#pragma once

// TRUEPOSE_EACH(ACTION, a, b, x, y, …) is ACTION(a, b, x) ACTION(a, b, y) …. The preprocessor has
// no loops: each element's text calls for the next one, and is scanned again.
#define TRUEPOSE_EACH(ACTION, a, b, ...) TRUEPOSE_SCAN(TRUEPOSE_ONE(ACTION, a, b, __VA_ARGS__))
#define TRUEPOSE_ONE(ACTION, a, b, member, ...) \
  ACTION(a, b, member)                          \
  __VA_OPT__(TRUEPOSE_NEXT TRUEPOSE_CALL(ACTION, a, b, __VA_ARGS__))
#define TRUEPOSE_NEXT() TRUEPOSE_ONE
#define TRUEPOSE_CALL ()
#define TRUEPOSE_SCAN(...) \
  TRUEPOSE_SCAN9(TRUEPOSE_SCAN9(TRUEPOSE_SCAN9(TRUEPOSE_SCAN9(__VA_ARGS__))))
#define TRUEPOSE_SCAN9(...) TRUEPOSE_SCAN3(TRUEPOSE_SCAN3(TRUEPOSE_SCAN3(__VA_ARGS__)))
#define TRUEPOSE_SCAN3(...) TRUEPOSE_SCAN1(TRUEPOSE_SCAN1(TRUEPOSE_SCAN1(__VA_ARGS__)))
#define TRUEPOSE_SCAN1(...) __VA_ARGS__
