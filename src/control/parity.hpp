// Parity: the disagreement of the redundant readings with the motors.
//
// p = P (q_e - h), P = [-J_r J, I]: redundant readings minus the values that the motors predict, at
// the motors' pose. p does not depend on the pose; an error b of one reading adds b g, g its column
// of P. Without faults its covariance is V = P (Σ_s + H_ξ Σ_ξ H_ξᵀ) Pᵀ, and pᵀV⁻¹p is χ². An
// unknown error b of one reading alone accounts for (gᵀV⁻¹p)²/(gᵀV⁻¹g) of it (generalised
// likelihood ratio) and leaves χ² with one degree of freedom less. (Gertler, Fault detection and
// diagnosis in engineering systems, 1998, chapter 6.)
#pragma once

#include <cstdint>

#include "estimation/estimate.hpp"

namespace truepose {
constexpr std::uint32_t bit(int reading) { return std::uint32_t{1} << reading; }

/// Readings at the pose that the motors give.
struct Parity {
  int n = 0;
  Extended expected;  ///< h
  Extended read;      ///< q_e
  Jacobians jacobians;
  SensorRows g;     ///< J_r J
  Reading value{};  ///< p
  Pose pose;

  /// Column of P.
  Reading signature(int r, int reading) const {
    Reading column{};
    for (int k = 0; k < r; ++k) column[k] = reading < n ? -g[k][reading] : reading - n == k;
    return column;
  }

  /// h, J and J_r J at a pose. @param beyond  the full level's addition to h
  Outcome look(const Robot& robot, const Pose& from, const Extended& beyond) {
    n = dof(robot.mobility);
    Closure closure;
    Reading values;
    SensorRows jr;
    Outcome outcome = ikm(robot, from, closure);
    if (outcome) outcome = jacobian(closure, jacobians);
    if (outcome) outcome = rkm(robot, closure, values, jr);
    if (!outcome) return outcome;
    extend(robot, closure.q(), values, expected);
    for (int c = 0; c < n + robot.r; ++c) expected[c] += beyond[c];
    for (int k = 0; k < robot.r; ++k)
      for (int j = 0; j < n; ++j) {
        g[k][j] = 0;
        for (int i = 0; i < n; ++i) g[k][j] += jr[k][i] * jacobians.J[i][j];
      }
    return {};
  }

  /// Finds the motors' pose by Newton from a pose nearby, and p there.
  Outcome locate(const Robot& robot, const Pose& near, const Extended& q_e,
                 const Extended& beyond) {
    n = dof(robot.mobility);
    constexpr Real kNear = 1e-3;  // motor error; one step leaves its square
    pose = near;
    read = q_e;
    Extended error;
    for (int left = 3; left > 0; --left) {
      const Outcome outcome = look(robot, pose, beyond);
      if (!outcome) return outcome;
      Real farthest = 0;
      innovation(robot, q_e, expected, error);
      Coordinates step{};
      for (int j = 0; j < n; ++j) {
        farthest = std::max(farthest, std::fabs(error[j]));
        for (int i = 0; i < n; ++i) step[i] += jacobians.J[i][j] * error[j];
      }
      pose = moved(robot.mobility, pose, step);
      if (farthest < kNear) break;
    }
    for (int k = 0; k < robot.r; ++k) {
      value[k] = error[n + k];
      for (int j = 0; j < n; ++j) value[k] -= g[k][j] * error[j];
    }
    const bool finite =
        all_finite(to_coordinates(robot.mobility, pose), n) && all_finite(value, robot.r);
    return {finite ? Status::ok : Status::not_finite, -1};
  }

  /// P diag(noise) Pᵀ + share · geometry, lower triangle. @param geometry  P H_ξ Σ_ξ H_ξᵀ Pᵀ
  void covariance(int r, const Extended& noise, const Matrix<kMaxSensors, kMaxSensors>& geometry,
                  Real share, ReadingCovariance& V) const {
    for (int k = 0; k < r; ++k)
      for (int l = 0; l <= k; ++l) {
        Real sum = share * geometry[k][l] + (k == l ? noise[n + k] : 0);
        for (int j = 0; j < n; ++j) sum += g[l][j] * noise[j] * g[k][j];
        V.L[k][l] = sum;
      }
  }

  /// P H_ξ: row k by a parameter.
  Real by(const Robot& robot, const Real* H_xi, int k, int column) const {
    const int width = parameter_count(robot);
    Real sum = H_xi[(n + k) * width + column];
    for (int j = 0; j < n; ++j) sum -= g[k][j] * H_xi[j * width + column];
    return sum;
  }

  /// P H_ξ S, r rows of B: the geometry's uncertainty in the parity.
  void open(const Robot& robot, const Knowledge& known, const Real* H_xi, Real* B) const {
    for (int k = 0; k < robot.r; ++k)
      for (int m = 0; m < known.count; ++m)
        B[k * known.count + m] = by(robot, H_xi, k, known.column[m]);
    times_root(known, robot.r, B);
  }

  /// σ of the change, between cycles at rest, of a sensor's value predicted by the motors.
  Real expectation_noise(const Extended& noise, int reading) const {
    Real sum = 0;
    if (reading >= n)
      for (int j = 0; j < n; ++j) sum += 2 * g[reading - n][j] * g[reading - n][j] * noise[j];
    return std::sqrt(sum);
  }
};

/// χ² of a parity, and the readings that alone may explain it.
struct Verdict {
  Real chi2 = 0;
  int freedom = 0;
  bool alarm = false;
  std::uint32_t may = 0;  ///< in an alarm: those readings, as bits,
  Extended by;            ///< and the error of each
};

/// Tests a parity. @param most  χ² beyond which there is an alarm, by degrees of freedom
/// @param V  factored @param without  excluded readings; `left_out` of them count in V
Verdict parity_verdict(const Parity& parity, const std::array<Real, kMaxSensors + 1>& most,
                       const ReadingCovariance& V, const Reading& value, int r,
                       std::uint32_t without, int left_out);
}  // namespace truepose
