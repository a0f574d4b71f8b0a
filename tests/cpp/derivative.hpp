// Derivatives by central differences of fourth order: truncation and rounding are about 1e-12.
#pragma once

#include <type_traits>

/// The derivative at 0 of f(step), a number or an array.
template <class F>
auto derivative(const F& f) {
  constexpr double h = 1e-4;
  const auto a = f(2 * h), b = f(h), c = f(-h), d = f(-2 * h);
  const auto slope = [](double a, double b, double c, double d) {
    return (8 * (b - c) - (a - d)) / (12 * h);
  };
  if constexpr (std::is_arithmetic_v<decltype(f(h))>) {
    return slope(a, b, c, d);
  } else {
    auto slopes = a;
    for (std::size_t k = 0; k < a.size(); ++k) slopes[k] = slope(a[k], b[k], c[k], d[k]);
    return slopes;
  }
}
