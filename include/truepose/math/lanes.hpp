// Values of all chains side by side, component by component, so that one instruction serves two.
#pragma once

#include "truepose/model/robot.hpp"

namespace truepose {
/// Two numbers processed together: one register of SSE2 or NEON.
using Pair = Eigen::Array<Real, 2, 1>;
inline Pair swapped(const Pair& pair) { return pair.reverse(); }

/// One number for each of N chains. Even N fill whole registers.
template <int N>
using Lanes = Eigen::Array<Real, N, 1>;

/// One vector for each of N chains, with the accessors of a Vec3 so that a formula serves both.
template <int N>
struct Points {
  Lanes<N> px, py, pz;

  const Lanes<N>& x() const { return px; }
  const Lanes<N>& y() const { return py; }
  const Lanes<N>& z() const { return pz; }
  Vec3 operator[](int i) const { return {px[i], py[i], pz[i]}; }
  Lanes<N> squared_norm() const { return px * px + py * py + pz * pz; }
};

/// value(i) for each of N chains. By pairs: a register load after two half-width stores stalls.
template <int N, class F>
inline Lanes<N> lanes(F&& value) {
  Lanes<N> result;
  for (int i = 0; i + 1 < N; i += 2) result.template segment<2>(i) = Pair(value(i), value(i + 1));
  if constexpr (N % 2 == 1) result[N - 1] = value(N - 1);
  return result;
}
template <int N, class F>
inline Points<N> points(F&& point) {
  return {lanes<N>([&](int i) { return point(i).x(); }),
          lanes<N>([&](int i) { return point(i).y(); }),
          lanes<N>([&](int i) { return point(i).z(); })};
}

/// The largest value. Eigen's maxCoeff calls through a function pointer, which clang cannot follow
/// when it checks that the control path never blocks.
template <int N>
inline Real largest(const Lanes<N>& values) {
  Real result = values[0];
  for (int i = 1; i < N; ++i) result = values[i] > result ? values[i] : result;
  return result;
}

/// Whether all are greater than 0; false for a NaN.
template <int N>
inline bool all_positive(const Lanes<N>& values) {
  bool result = true;
  for (int i = 0; i < N; ++i) result &= values[i] > 0;
  return result;
}
}  // namespace truepose
