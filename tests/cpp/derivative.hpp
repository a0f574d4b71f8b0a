// Derivatives by central differences of fourth order: truncation and rounding are about 1e-12.
#pragma once

#include <iterator>
#include <type_traits>

/// The derivative at 0 of f(step), a number or an array.
template <class F>
auto derivative(const F& f) {
  constexpr double h = 1e-4;
  const auto a = f(2 * h), b = f(h), c = f(-h), d = f(-2 * h);
  if constexpr (std::is_arithmetic_v<decltype(f(h))>) {
    return (8 * (b - c) - (a - d)) / (12 * h);
  } else {
    auto slope = a;
    for (int k = 0; k < std::ssize(a); ++k)
      slope[k] = (8 * (b[k] - c[k]) - (a[k] - d[k])) / (12 * h);
    return slope;
  }
}
