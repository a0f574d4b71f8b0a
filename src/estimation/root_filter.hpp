// Square-root filter on ξ: equations in, one after another.
//
// r equations F ζ = y, ζ of unit variance (δξ = S ζ), each with noise. Each innovation is
// independent of those before: Σ y²/total is yᵀ(R + F Fᵀ)⁻¹y, χ² with r degrees of freedom. The
// update is Carlson's triangular form (Bierman, Factorization Methods for Discrete Sequential
// Estimation, 1977, chapter V). Bounded work, no allocation, no exception.
#pragma once

#include "estimation/evidence.hpp"
#include "estimation/knowledge.hpp"

namespace truepose {
/// ξ̂ and its covariance S Sᵀ. Arrays are the caller's.
struct RootFilter {
  int count = 0;                         ///< p, uncertain parameters
  const std::int32_t* column = nullptr;  ///< each one's column of H_ξ
  Real* xi = nullptr;                    ///< ξ̂, parameter_count values; nullptr: none
  Real* root = nullptr;                  ///< S, p×p by rows, lower triangular

  /// Copies another one's numbers.
  void assign(const RootFilter& from) {
    for (int k : range(count)) xi[column[k]] = from.xi[column[k]];
    std::copy_n(from.root, count * count, root);
  }
};

/// r equations B δξ = e about ξ of one row, linearised at `about`, with noise of unit covariance.
struct Equations {
  int r = 0, readings = 0;
  const Real *B = nullptr, *G = nullptr;  ///< r × p; r × readings, by an error of one σ of each
  const Real *e = nullptr, *about = nullptr;
  const Real* loaded = nullptr;  ///< r, by a payload; nullptr: as its step
  Real curvature = 0;            ///< second-order remainder over the square of the loop residual
};

/// r equations, each made independent of those before.
struct Innovations {
  int r = 0;
  Matrix<kMaxReadings, kMaxReadings> L;         ///< coefficients on the equations before
  std::array<Real, kMaxReadings> y;             ///< independent
  std::array<Real, kMaxReadings> noise, total;  ///< their variances: own; with the parameters'

  Real chi2() const {
    return sum_of(r, [&](int i) { return y[i] * y[i] / total[i]; });
  }
  /// Transforms a column of the equations likewise. @return its evidence
  Column transform(std::array<Real, kMaxReadings>& column) const {
    Column evidence;
    for (int i : range(r)) {
      for (int k : range(i)) column[i] -= L[i][k] * column[k];
      evidence.add(column[i], y[i], total[i]);
    }
    return evidence;
  }
};

/// Decorrelates the equations F ζ = y: each is as after the filter's update by those before.
/// @param F  in: r×p; out: its row i belongs to the root after i updates (Carlson's form)
void decorrelate(int p, Real* F, Real curvature, Innovations& made);

/// Innovations of a row's equations. @param F  out: r×p, as of decorrelate
/// @return not_finite where an update by them would corrupt every later state
Outcome innovate(const RootFilter& filter, const Equations& row, Real* F, Innovations& made);

/// Updates the filter. @param gain  out: r×p, gains times the innovations' variances
void update(const Innovations& made, const Real* F, RootFilter& filter, Real* gain);

/// S Sᵀ + v vᵀ, triangular again, by one rotation per column. @param v  p numbers; overwritten
void add_drift(int p, Real* S, Real* v);
}  // namespace truepose
