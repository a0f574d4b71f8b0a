// The precision of all computation: double, or single for machines without a double unit.
//
// Single precision is for small machines' builds of the control path and needs a compiler that
// takes a constant like 0.1 as single too (gcc's -fsingle-precision-constant):
// docs/small-machines.md. What is under offline/ is always double.
#pragma once

#include <limits>
#include <type_traits>

namespace truepose {

#ifdef TRUEPOSE_SINGLE
using Real = float;
#else
using Real = double;
#endif

/// A tolerance that follows the type: where rounding, or a power of it, decides.
constexpr Real by_precision(long double in_double, long double in_single) {
  return static_cast<Real>(std::is_same_v<Real, float> ? in_single : in_double);
}

}  // namespace truepose
