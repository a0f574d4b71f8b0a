// Compiler attributes: which calls to inline, and which never.
#pragma once

/// FLATTEN inlines all calls inside a hot function. Eigen's small expressions otherwise stay calls,
/// which costs a tenth of a simulation (benchmarks/README.md). Not under AddressSanitizer, which
/// makes each inlined copy several times larger, nor where clang is asked for size; at g++'s -Os it
/// nearly halves a cycle for a twentieth of the size. APART keeps what is long out of such a
/// function.
#if defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__) && \
    !(defined(__clang__) && defined(__OPTIMIZE_SIZE__))
#define TRUEPOSE_FLATTEN __attribute__((flatten))
#define TRUEPOSE_APART __attribute__((noinline))
#else
#define TRUEPOSE_FLATTEN
#define TRUEPOSE_APART
#endif

/// Keeps a way that is hardly ever taken out of the hot function around it, even a flattened one.
#if defined(__GNUC__)
#define TRUEPOSE_RARE __attribute__((noinline, cold))
#else
#define TRUEPOSE_RARE
#endif
