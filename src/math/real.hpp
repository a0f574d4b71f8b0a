// The precision of all computation: double, or single for machines without a double unit.
//
// Single precision serves the control path on small machines; constants like 0.1 must be single,
// too (gcc's -fsingle-precision-constant): docs/small-machines.md. Calibration and simulation are
// always double.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <type_traits>

#include "truepose/sizes.hpp"

namespace truepose {
using std::fabs, std::sqrt, std::max, std::min, std::clamp, std::isfinite, std::isnan;
using std::sin, std::cos, std::atan2, std::exp, std::log, std::copysign, std::remainder;

inline constexpr Real kPi = std::numbers::pi_v<Real>;

/// A tolerance at the level of rounding, or a power of it, by precision.
constexpr Real by_precision(long double in_double, long double in_single) {
  return Real(std::is_same_v<Real, float> ? in_single : in_double);
}

/// The numbers first, first + 1, …, end - 1, for loops; first is 0 by default.
struct range {
  int at, last;
  constexpr explicit range(int end) : range(0, end) {}
  constexpr range(int first, int end) : at(first), last(end) {}
  constexpr range begin() const { return *this; }
  constexpr int end() const { return last; }
  constexpr int operator*() const { return at; }
  constexpr void operator++() { ++at; }
  constexpr bool operator!=(int end) const { return at < end; }
};

/// Copies the first n entries of an array.
template <class From, class To>
constexpr void copy_first(int n, const From& from, To&& to) {
  for (int i : range(n)) to[i] = from[i];
}

/// term(0) + term(1) + … + term(count - 1).
template <class F>
constexpr Real sum_of(int count, F&& term) {
  Real sum = 0;
  for (int k : range(count)) sum += term(k);
  return sum;
}
}  // namespace truepose
