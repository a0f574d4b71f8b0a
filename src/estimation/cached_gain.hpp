// The gain matrix of an estimate, cached from cycle to cycle.
//
// C = H_ξ Σ_ξ H_ξᵀ + Σ_s: the first term is expensive, the second may change in any cycle (excluded
// readings). The first is cached in coordinates in which it changes slowly with the pose.
// e = q_e - h is split into the motors' pose error, e_x = J e_q with J = H_q⁻¹, and the parity,
// p = e_r - H_r e_x. Their errors have the covariance [[A, N], [Nᵀ, V]],
//
//     A = A_ξ + S,   N = N_ξ - S H_rᵀ,   V = V_ξ + Σ_r + H_r S H_rᵀ,   S = J Σ_q Jᵀ,
//
// and generalised least squares is
//
//     δx = e_x - K p,   K = N V⁻¹,   cov(δx) = P = A - K V Kᵀ,   gain = [(I + K H_r) J, -K].
//
// A_ξ, N_ξ and V_ξ are cached; H, Σ_s and all that follows from them are current. So gain · H = I
// to rounding with any cache: a robot at its target has no error, one that is off has its whole
// error. An error in the placing of the base changes e_x alone, equally at every pose, and a
// perfect sensor of one coordinate stays perfect; not so with C or K in the cache (docs/model.md).
//
// With K₀ of another pose x̂ changes by (K₀ - K) p: coordinate i by at most s σ_i √χ², χ² that of p
// (r on average), by s σ_i RMS, and its variance grows by s², where
//
//     s² = max_i [(K₀ - K) V (K₀ - K)ᵀ]_ii / P_ii.
//
// s grows with the distance from K₀'s pose. A refresh measures it and sets how far the next may be.
#pragma once

#include <bit>

#include "estimation/estimate.hpp"

namespace truepose {
/// The cache, the caller's, one for each controller. A new one is empty.
struct CachedGain {
  Real share = 0.1;      ///< largest s, as predicted
  std::uint64_t of = 0;  ///< fingerprint of robot and knowledge; 0: empty
  Joint q{};             ///< of the motors where it was computed
  Real reach = 0;        ///< validity radius: travel of the motors, added up, rad or m
  Real became = 0;       ///< relative gain error s found by the last refresh
  Real slope = 0;        ///< s per travel, largest of the refreshes, older ones discounted
  Matrix<kMaxReadings, kMaxReadings> C{};  ///< lower triangle of [[A_ξ, N_ξ], [N_ξᵀ, V_ξ]]

  /// Travel of the motors since the refresh, added up.
  Real way(int n, const Joint& now) const {
    return sum_of(n, [&](int i) { return fabs(now[i] - q[i]); });
  }
};
static_assert(std::is_trivially_copyable_v<CachedGain> && std::is_standard_layout_v<CachedGain>);

inline constexpr Real kFirstReach = 2e-3;  ///< rad or m
inline constexpr Real kMostReach = 0.1;
inline constexpr Real kTooFar = 0.3;   ///< s no longer grows with the travel
inline constexpr Real kForgets = 0.9;  ///< factor on the slope so far, per refresh
/// Factor by which s may grow faster on the way to the next refresh than to the last.
inline constexpr Real kFaster = 4;

/// Fingerprint of everything but the pose that the geometry's part of C depends on: FNV-1a by
/// words. (Of S the diagonal: no sample and no other prior leaves that as it was.)
std::uint64_t fingerprint(const Robot& robot, const Knowledge& known);

/// Generalised least squares at a pose, with cached weights. For as many motors as freedoms: with
/// more, laws compute the weights in every cycle.
struct CachedFusion {
  int n;
  Square J;                               ///< H_q⁻¹
  SensorRows g;                           ///< H_r J
  Matrix<kMaxDof, kMaxSensors> whitened;  ///< K L, V = L Lᵀ
  Matrix<kMaxDof, kMaxSensors> gain;      ///< K
  Coordinates variance;                   ///< diagonal of P
  ReadingCovariance V;                    ///< factored

  /// Computes J and H_r J. @return whether H_q has an inverse
  bool set_jacobians(const Robot& robot, const PoseRows& H_x) {
    n = dof(robot.mobility);
    Square H_q;
    Unknowns size;
    for (int j : range(n)) {
      for (int i : range(n)) H_q[i][j] = H_x[i][j];
      size[j] = sum_of(n, [&](int i) { return H_q[i][j] * H_q[i][j]; });
    }
    if (!invert(n, n, H_q, size, J)) return false;
    for (int k : range(robot.r))
      for (int j : range(n)) g[k][j] = sum_of(n, [&](int i) { return H_x[n + k][i] * J[i][j]; });
    return true;
  }

  /// Computes K and P from the cache. @return not_finite where V is no covariance
  Outcome weigh(const Robot& robot, const Knowledge& known, const CachedGain& kept) {
    const int r = robot.r;
    const auto& C = kept.C;
    SensorRows noisy;  // H_r J Σ_q
    std::array<Real, kMaxReadings> own;
    for (int c : range(n + r)) own[c] = known.sigma[c] * known.sigma[c];
    for (int k : range(r)) {
      for (int j : range(n)) noisy[k][j] = g[k][j] * own[j];
      for (int l : range(k + 1)) {
        V.L[k][l] = C[n + k][n + l] + (k == l ? own[n + k] : 0);
        for (int j : range(n)) V.L[k][l] += noisy[k][j] * g[l][j];
      }
    }
    if (!V.factor(r)) return {Status::not_finite};
    for (int i : range(n)) {
      variance[i] = C[i][i];
      for (int j : range(n)) variance[i] += J[i][j] * J[i][j] * own[j];
      for (int k : range(r)) {
        whitened[i][k] = C[n + k][i];
        for (int j : range(n)) whitened[i][k] -= J[i][j] * noisy[k][j];
      }
      V.whiten(r, whitened[i].data(), 1);
      for (int k : range(r)) variance[i] -= whitened[i][k] * whitened[i][k];
      gain[i] = whitened[i];
      V.colour(r, gain[i].data());
    }
    return {};
  }

  /// Step to the pose of all readings. @param e  q_e - h @return χ² of the parity
  Real step(const Robot& robot, const Extended& e, Coordinates& step) const {
    Reading p{};
    for (int k : range(robot.r)) {
      p[k] = e[n + k];
      for (int j : range(n)) p[k] -= g[k][j] * e[j];
    }
    for (int i : range(n)) {
      step[i] = sum_of(n, [&](int j) { return J[i][j] * e[j]; });
      for (int k : range(robot.r)) step[i] -= gain[i][k] * p[k];
    }
    V.whiten(robot.r, p.data(), 1);
    return sum_of(robot.r, [&](int k) { return p[k] * p[k]; });
  }

  /// TEJ: H_q times the gain, [I + K' g, -K'] with K' = H_q K.
  void tej(const Robot& robot, const PoseRows& H_x, ExtendedRows& M_plus) const {
    for (int i : range(n)) {
      for (int c : range(n)) M_plus[i][c] = i == c;
      for (int k : range(robot.r)) {
        const Real sum = sum_of(n, [&](int j) { return H_x[i][j] * gain[j][k]; });
        for (int c : range(n)) M_plus[i][c] += sum * g[k][c];
        M_plus[i][n + k] = -sum;
      }
    }
  }
};

/// Refreshes the cache at a pose, and measures the error of the old one.
/// @param q   of the motors there
/// @param at  in: placed; out: weighed
/// @param B   work space, (n + r)×count
/// @return not_finite where some σ is not a positive number
Outcome refresh(const Robot& robot, const Knowledge& known, std::uint64_t mark, const Joint& q,
                const PoseRows& H_x, const Real* H_xi, Real* B, CachedGain& kept, CachedFusion& at);
}  // namespace truepose
