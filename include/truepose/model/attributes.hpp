// Compiler attributes that control inlining.
#pragma once

/// FLATTEN inlines all calls in a hot function. Eigen's small expressions otherwise stay calls,
/// which cost a tenth of a simulation (benchmarks/README.md); at g++'s -Os FLATTEN nearly halves a
/// control cycle for a twentieth more code. Off under AddressSanitizer, which makes each inlined
/// copy several times larger, and where clang optimises for size. APART keeps long code out of it.
#if defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__) && \
    !(defined(__clang__) && defined(__OPTIMIZE_SIZE__))
#define TRUEPOSE_FLATTEN __attribute__((flatten))
#define TRUEPOSE_APART __attribute__((noinline))
#else
#define TRUEPOSE_FLATTEN
#define TRUEPOSE_APART
#endif

/// Keeps a rarely executed function out of the hot function around it, even a flattened one.
#if defined(__GNUC__)
#define TRUEPOSE_RARE __attribute__((noinline, cold))
#else
#define TRUEPOSE_RARE
#endif
