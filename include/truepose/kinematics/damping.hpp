// Conditioning of a pose, and a damped Jacobian near singularities.
//
// J = J_x⁻¹ J_q grows without bound where the rods' lines become dependent (type 2), J⁻¹ where an
// arm stretches (type 1). Levenberg's damping in a band (Nakamura and Hanafusa 1986) bounds both
// (docs/model.md, Beside a singularity).
#pragma once

#include "truepose/kinematics/jacobian.hpp"

namespace truepose {
/// λ² at the conditioning c: 0 from `band` on, band²/4 at c = 0. A gain 1/σ, σ ≥ c, becomes
/// σ/(σ² + λ²): continuous, and nowhere above 2/(√3 band).
inline Real damping(Real c, Real band) { return c < band ? 0.25 * (band * band - c * c) : 0; }

/// Distance from singularities of a closed mechanism, independent of its size and units.
template <Mobility K>
class Conditioning {
 public:
  static constexpr int n = kDof<K>;

  TRUEPOSE_FLATTEN explicit Conditioning(const Closure<K>& closure) {
    const auto& chain = closure.chain;
    const Points<n> v = points<n>([&](int i) -> const Vec3& { return chain[i].v; });
    const Points<n> lever = points<n>([&](int i) -> const Vec3& { return chain[i].lever; });
    length_ = v.squared_norm().sqrt();
    const Lanes<n> per_length = 1 / length_;
    const Points<n> along{v.px * per_length, v.py * per_length, v.pz * per_length};
    jx_row<K>(closure.carried, along, lever, columns_);
    unit_ = column_sizes<K>(closure.carried, Lanes<n>::Ones(), lever);
    ones_.fill(1);
    for (int j = 0; j < n; ++j) {
      unit_[j] = std::sqrt(unit_[j]);
      columns_[j] *= 1 / unit_[j];
      square_ += columns_[j].square().sum();
    }
    Matrix<n, n> rows;
    inverse_ = invert<n>(columns_, ones_, Lanes<n>::Ones(), 0, rows);
    Lanes<n> inverse2 = Lanes<n>::Zero();
    for (const auto& row : rows) inverse2 += Eigen::Map<const Lanes<n>>(row.data()).square();
    parallel_ = inverse_ ? n / std::sqrt(square_ * inverse2.sum()) : 0;
    // A telescopic leg always drives along itself.
    const Lanes<n> dB =
        points<n>([&](int i) -> const Vec3& { return chain[i].dB; }).squared_norm().sqrt();
    speed_ = (dB > 0).select(dB, lanes<n>([&](int i) { return std::fabs(chain[i].rate); }));
    serial_ = lanes<n>([&](int i) { return std::fabs(chain[i].jq); }) / (length_ * speed_);
  }

  /// Type 2: inverse condition number n / (|A| |A⁻¹|), Frobenius norms; 1: isotropic, 0: the motors
  /// do not hold the platform. A: the rods' unit lines, columns in units of column_sizes.
  Real parallel() const { return parallel_; }
  /// Type 1: share of the motion of B_i along rod i, in [0, 1]. 0: arm and rod in one line.
  Real serial(int i) const { return serial_[i]; }
  /// The smallest conditioning of both types.
  Real least() const { return std::min(parallel_, -largest<n>(-serial_)); }
  /// The status that jacobian() would return, and the sign of det J_x.
  Outcome outcome() const {
    for (int i = 0; i < n; ++i)
      if (!(serial_[i] * serial_[i] > kSingular)) return {Status::singular, i};
    return {inverse_ ? Status::ok : Status::singular, -1};
  }
  int sign() const { return (inverse_.determinant > 0) - (inverse_.determinant < 0); }

  /// J = A⁺ J_q with A⁺ = (AᵀA + λ² |A|²/n²)⁻¹ Aᵀ, rescaled to SI units.
  bool damped(const Closure<K>& closure, Real band, Matrix<kDof<K>, kDof<K>>& J) const {
    const Real part = damping(parallel_, band) * square_ / (n * n);
    const Matrix<n, n> lines = rows_of<n>(columns_);
    const NormalEquations<n> equations(lines, ones_, part);
    for (int j = 0; j < n; ++j) {
      const std::array<Real, n> column = equations.column(j, closure.chain[j].jq / length_[j]);
      for (int i = 0; i < n; ++i) J[i][j] = column[i] / unit_[i];
    }
    return equations.regular();
  }

  /// Divisor of J⁻¹ in place of the entry s of J_q: s + λ²/s, so that 1/s becomes s/(s² + λ²).
  Real divisor(int i, Real jq, Real band) const {
    const Real scale = length_[i] * speed_[i];
    return jq + damping(serial_[i], band) * scale * scale / jq;
  }

 private:
  std::array<Lanes<n>, n> columns_;  ///< A
  std::array<Real, n> unit_, ones_;
  Lanes<n> length_, speed_, serial_;
  Real square_ = 0, parallel_;  // |A|²
  Inverted inverse_;
};

/// Computes J_x, J_q and J, damped where a conditioning is below `band` (0: never, as in the
/// paper). In the band the divisors of J⁻¹ replace the entries of J_q, also in the closure, so that
/// rates, J_r and the dynamics follow.
/// @return near_singular in the band, with a finite and bounded answer; `chain` is the chain whose
/// arm is stretched, or -1 where the rods' lines are nearly dependent.
template <Mobility K>
inline Outcome jacobian(Closure<K>& closure, Real band, Jacobians<K>& jacobians) {
  const Outcome exact = jacobian<K>(closure, jacobians);
  if (!(band > 0)) return exact;
  const Conditioning<K> conditioning(closure);
  const bool dependent = conditioning.parallel() < band;
  Outcome outcome{Status::ok, -1};
  if (dependent || !exact) {
    for (int i = 0; i < kDof<K>; ++i) {
      jx_row<K>(closure.carried, closure.chain[i].v, closure.chain[i].lever, jacobians.jx[i]);
      jacobians.jq[i] = closure.chain[i].jq;
    }
    if (!conditioning.damped(closure, band, jacobians.J)) return {Status::singular, -1};
    outcome.status = Status::near_singular;
  }
  for (int i = 0; i < kDof<K>; ++i) {
    if (!(conditioning.serial(i) < band)) continue;
    closure.chain[i].jq = jacobians.jq[i] = conditioning.divisor(i, jacobians.jq[i], band);
    if (outcome.chain < 0 && !dependent) outcome = {Status::near_singular, i};
  }
  return outcome;
}

/// Computes the conditioning at coordinates x. @param serial  out, size n
inline Outcome conditioning(const Robot& robot, const Coordinates& x, Real& parallel,
                            Joint& serial) {
  return with_mobility(robot.mobility, [&]<Mobility K>(Fixed<K>) {
    Closure<K> closure;
    const Outcome outcome = ikm<K, false>(robot, to_pose<K>(x), closure);
    if (!outcome) return outcome;
    const Conditioning<K> at(closure);
    parallel = at.parallel();
    for (int i = 0; i < kDof<K>; ++i) serial[i] = at.serial(i);
    return Outcome{all_finite(serial, kDof<K>) ? Status::ok : Status::not_finite, -1};
  });
}
}  // namespace truepose
