// Parity: the disagreement of the redundant readings with the motors.
//
// p = P (q_e - h), P = [-J_r J, I]: redundant readings minus the values that the motors predict, at
// the motors' pose (of more motors than freedoms that of their least squares; p has no part of
// their own disagreement). p does not depend on the pose; an error b of one reading adds b g, g its
// column of P. Without faults its covariance is V = P (Σ_s + H_ξ Σ_ξ H_ξᵀ) Pᵀ, and pᵀV⁻¹p is χ². An
// unknown error b of one reading alone accounts for (gᵀV⁻¹p)²/(gᵀV⁻¹g) of it (generalised
// likelihood ratio) and leaves χ² with one degree of freedom less. (Gertler, Fault detection and
// diagnosis in engineering systems, 1998, chapter 6.)
#pragma once

#include <cstdint>

#include "estimation/estimate.hpp"

namespace truepose {
constexpr std::uint32_t bit(int reading) { return std::uint32_t{1} << reading; }

/// Whether a reading, rad or m, is a number. False also where later numbers would overflow.
inline bool number(Real reading) { return fabs(reading) < 1e9; }

/// P H_ξ Σ_ξ H_ξᵀ Pᵀ, lower triangle.
using ParityGeometry = Matrix<kMaxSensors, kMaxSensors>;

/// The motors' pose from cycle to cycle.
struct MotorsPose {
  bool placed = false;  ///< `pose` is that of the last cycle
  Pose pose;
  Coordinates motion{};  ///< in that cycle
};

/// Readings at the pose that the motors give.
struct Parity {
  int n = 0;          ///< motors
  Extended expected;  ///< h
  Extended read;      ///< q_e
  Jacobians jacobians;
  PredictionRows g;  ///< J_r J
  Reading value{};   ///< p
  Pose pose;

  /// Column of P.
  Reading signature(int r, int reading) const;

  /// h, J and J_r J at a pose. @param beyond  the full level's addition to h
  Outcome look(const Robot& robot, const Pose& from, const Extended& beyond);

  /// Finds the motors' pose by Newton from where the last cycle leads, or from scratch, and p
  /// there.
  Outcome locate(const Robot& robot, const MotorsPose& last, const Extended& q_e,
                 const Extended& beyond);

  /// P diag(noise) Pᵀ + share · geometry, lower triangle.
  void covariance(int r, const Extended& noise, const ParityGeometry& geometry, Real share,
                  ReadingCovariance& V) const;

  /// The geometry's uncertainty in p at a pose, of the robot's level, and the readings' addition to
  /// the ideal level's.
  /// @param work  estimate_work(robot, known.count) numbers
  /// @param rest  residual motion. In: at a pose nearby; out: at this one, if ok
  Outcome geometry_at(const Robot& robot, const Pose& pose, const Knowledge& known, Real* work,
                      ParityGeometry& geometry, Extended& beyond, Parasitic& rest) const;
};

/// χ² of a parity. @param V  factored
Real chi_squared(const ReadingCovariance& V, int r, Reading parity);
}  // namespace truepose
