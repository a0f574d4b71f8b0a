// Conditioning of a pose, and a damped Jacobian near singularities.
//
// J = J_x⁻¹ J_q grows without bound where the rods' lines become dependent (type 2), J⁻¹ where an
// arm stretches (type 1). Levenberg's damping in a band (Nakamura and Hanafusa 1986) bounds both
// (docs/model.md, Beside a singularity).
#pragma once

#include "mechanism/jacobian.hpp"

namespace truepose {
/// λ² at the conditioning c: 0 from `band` on, band²/4 at c = 0. A gain 1/σ, σ ≥ c, becomes
/// σ/(σ² + λ²): continuous, and nowhere above 2/(√3 band).
inline Real damping(Real c, Real band) { return c < band ? 0.25 * (band * band - c * c) : 0; }

/// Distance from singularities of a closed mechanism, independent of its size and units.
class Conditioning {
 public:
  explicit Conditioning(const Closure& closure);

  /// Type 2: inverse condition number n / (|A| |A⁻¹|), Frobenius norms; 1: isotropic, 0: the motors
  /// do not hold the platform. A: the rods' unit lines, columns in units of their sizes in
  /// jx_rows().
  Real parallel() const { return parallel_; }
  /// Type 1: share of the motion of B_i along rod i, in [0, 1]. 0: arm and rod in one line.
  Real serial(int i) const { return serial_[i]; }
  /// The smallest conditioning of both types.
  Real least() const {
    return min(parallel_, *std::min_element(serial_.begin(), serial_.begin() + motors_));
  }
  /// The status that jacobian() would return.
  Outcome outcome() const;
  /// The sign of det J_x (0: not square).
  int sign() const { return inverse_.sign; }

  /// J = A⁺ J_q with A⁺ = (AᵀA + λ² |A|²/n²)⁻¹ Aᵀ, rescaled to SI units. With more motors than
  /// freedoms, rows of K replace those of A, and divisors the entries of J_q in it.
  bool damped(const Closure& closure, Real band, Square& J) const;

  /// Divisor of J⁻¹ in place of the entry s of J_q: s + λ²/s, so that 1/s becomes s/(s² + λ²).
  Real divisor(int i, Real jq, Real band) const {
    const Real scale = length_[i] * speed_[i];
    return jq + damping(serial_[i], band) * scale * scale / jq;
  }

 private:
  int n_, motors_;
  Square lines_;  ///< A, m×n
  Unknowns unit_;
  Joint length_, speed_, serial_;
  Real square_ = 0, parallel_;  // |A|²
  Inverted inverse_;
};

/// Computes J_x, J_q and J, damped where a conditioning is below `band` (0: never, as in the
/// paper). In the band the divisors of J⁻¹ replace the entries of J_q, also in the closure, so that
/// rates, J_r and the dynamics follow.
/// @return near_singular in the band, with a finite and bounded answer; `chain` is the chain whose
/// arm is stretched, or -1 where the rods' lines are nearly dependent.
Outcome jacobian(Closure& closure, Real band, Jacobians& jacobians);

/// Computes the conditioning at coordinates x. @param serial  out, size n
Outcome conditioning(const Robot& robot, const Coordinates& x, Real& parallel, Joint& serial);
}  // namespace truepose
