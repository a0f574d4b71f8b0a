// Noise of a printer's readings, the test of each reading against all others, left-out readings.
//
// With every unknown in units of its prior σ, the readings are linear at the estimate:
//
//     y = G u + ε,  u ~ N(0, 1),  ε ~ N(0, σ_g²),
//
// with one noise σ_g of the heights and one of the distances. The prior of σ_g² is a
// scaled-inverse-χ² distribution with ν₀ = 3 degrees of freedom around the assumed noise. The
// marginal likelihood (u integrated out) over log σ has its maximum where
//
//     σ_g² = (ν₀ σ₀² + r_gᵀ r_g) / (ν₀ + ν_g),  ν_g = m_g - tr_g(G P Gᵀ) / σ_g²,
//
// with r the residual at that noise, P the covariance of u, m_g the number of readings; ν_g are
// their degrees of freedom beyond the parameters. Parameters and predictions then follow Student's
// t with ν₀ + ν_g degrees of freedom. Noise::deviation() is the standard deviation of this t, not
// its scale; 1.96 of it contain 95 % for three degrees of freedom and more.
//
// A left-out reading differs by e from its prediction, whose scale is √v, v = σ² + g P g with noise
// and P of the other readings. Of m readings it is rejected if |e| / √v > t(1 - α/2m); α is 0.5 %
// in all. An error of √v (t(1 - α/2m) + t(0.9)) or more is rejected in at least 90 % of cases.
#pragma once

#include <unsupported/Eigen/SpecialFunctions>

#include "truepose/printers/fit.hpp"

namespace truepose::printers {
constexpr double kDof = 3;  ///< ν₀: half of all printers have 0.6 to 1.6 times the assumed noise
constexpr double kFalseAlarm = 0.005;  ///< α: probability of rejecting correct readings
constexpr double kPower = 0.9;         ///< probability of detecting a detectable error
constexpr double kError = 0.3 * kMm;   ///< of one height, detectable for a verdict
constexpr double kLayer = 0.15 * kMm;  ///< noise of the heights that prevents a first layer
constexpr int kMostAdvised = 24;       ///< heights to add

/// P(|T| > t) of Student's t (Abramowitz and Stegun, 26.7.1).
inline double student_tails(double t, double dof) {
  return Eigen::numext::betainc(0.5 * dof, 0.5, dof / (dof + t * t));
}
/// The t that Student's t exceeds with a probability below 0.5.
inline double student_beyond(double probability, double dof) {
  double low = 0, high = 1;
  while (0.5 * student_tails(high, dof) > probability && high < 1e6) high *= 2;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (0.5 * student_tails(middle, dof) > probability ? low : high) = middle;
  }
  return high;
}
/// P(χ² > x) for any degrees of freedom.
inline double chi2_tail(double x, double dof) { return Eigen::numext::igammac(0.5 * dof, 0.5 * x); }

/// Noise of heights and of distances, and the estimate at that noise.
struct Noise {
  double sigma[2];  ///< scale of Student's t, m
  double dof[2];    ///< its degrees of freedom
  Vector u;         ///< unknowns, in units of their prior σ
  Matrix P;         ///< their covariance

  double deviation(int kind) const { return sigma[kind] * sqrt(dof[kind] / (dof[kind] - 2)); }
};

/// Linear readings y = G u + ε, the heights first.
struct Linear {
  Matrix G;
  Vector y;
  int heights;
};
inline Linear linear(const Delta& delta, const Readings& readings, const Estimate& found) {
  const Errors e = errors(delta, found.theta, readings, true);
  const Matrix G = e.slopes * found.S;
  return {G, G * found.u - e.off, heights_of(readings)};
}

/// The noise of linear readings, without one of them, from a start of σ. `assumed`: the prior's
/// centre.
inline Noise noise_of(const Linear& of, const Assumed& assumed, const double* start,
                      int without = -1) {
  constexpr int kRounds = 100;
  const Matrix& G = of.G;
  Noise found{{start[0], start[1]}, {}, {}, {}};
  for (int round = 0; round < kRounds; ++round) {
    Vector w(of.y.size());
    for (int k = 0; k < w.size(); ++k)
      w[k] = k == without ? 0 : pow(found.sigma[k >= of.heights], -2);
    const Matrix I = Matrix::Identity(G.cols(), G.cols());
    found.P = (I + G.transpose() * w.asDiagonal() * G).inverse();
    found.u = found.P * G.transpose() * w.cwiseProduct(of.y);
    const Vector off = of.y - G * found.u, lever = (G * found.P).cwiseProduct(G).rowwise().sum();
    double left[2], change = 0;
    for (int kind = 0; kind < 2; ++kind)
      found.dof[kind] = kDof, left[kind] = kDof * pow(assumed.noise(kind), 2);
    for (int k = 0; k < w.size(); ++k)
      if (const int kind = k >= of.heights; k != without) {
        found.dof[kind] += 1 - w[k] * lever[k];
        left[kind] += off[k] * off[k];
      }
    for (int kind = 0; kind < 2; ++kind) {
      const double last = found.sigma[kind];
      found.sigma[kind] = sqrt(left[kind] / found.dof[kind]);
      change = max(change, fabs(found.sigma[kind] / last - 1));
    }
    if (change < 1e-4) break;
  }
  return found;
}

/// The error of one of `count` readings that is rejected in 90 % of cases.
inline double detectable(double scale, double dof, int count) {
  return scale * (student_beyond(kFalseAlarm / (2 * count), dof) + student_beyond(1 - kPower, dof));
}
/// Every reading tested against all others, and its detectability.
struct Judged {
  Noise noise;
  Vector off, scale;       ///< reading − prediction from the others, m; scale of it
  Vector shows;            ///< error of the reading that is rejected in 90 % of cases, m
  int wrong = -1;          ///< the reading rejected by the test, or -1
  double least = 0;        ///< error detectable in half of the heights, m
  bool scattered = false;  ///< the heights' noise exceeds that of a possible first layer, at 99.5 %
};
inline Judged judge(const Linear& of, const Assumed& assumed) {
  const int count = int(of.y.size());
  Judged judged;
  judged.noise = noise_of(of, assumed, &assumed.sigma[TRUEPOSE_PRINTER_HEIGHT]);
  judged.off = judged.scale = judged.shows = Vector(count);
  double least_chance = kFalseAlarm / count;
  for (int k = 0; k < count; ++k) {
    const bool kind = k >= of.heights;
    const Noise by = noise_of(of, assumed, judged.noise.sigma, k);
    const Vector g = of.G.row(k);
    judged.off[k] = of.y[k] - g.dot(by.u);
    judged.scale[k] = sqrt(pow(by.sigma[kind], 2) + g.dot(by.P * g));
    const double chance = student_tails(judged.off[k] / judged.scale[k], by.dof[kind]);
    if (chance < least_chance) {
      least_chance = chance;
      judged.wrong = k;
    }
    judged.shows[k] = detectable(judged.scale[k], by.dof[kind], count);
  }
  const vector<double> shows(judged.shows.begin(), judged.shows.begin() + of.heights);
  judged.least = median(shows);
  const double dof = judged.noise.dof[0], over = judged.noise.sigma[0] / kLayer;
  judged.scattered = chi2_tail(dof * over * over, dof) < kFalseAlarm;
  return judged;
}

/// Evenly spread points of a disc at z = 0.
inline vector<Vector3> spread(int count, double radius) {
  vector<Vector3> points;
  for (int k = 0; k < count; ++k) {
    const double turn = 180 * kDegree * (3 - sqrt(5.0)) * k;
    const double ring = radius * sqrt((k + 0.5) / count);
    points.emplace_back(ring * cos(turn), ring * sin(turn), 0);
  }
  return points;
}
/// Slopes of the nozzle at x by the free unknowns, in units of their prior σ; NaN out of reach.
inline Matrix slopes(const Delta& delta, const Estimate& found, const Vector3& x) {
  return delta.slopes(found.theta, x) * found.S.topRows(delta.count());
}
/// How many heights within `radius` to add so that half of all show an error of 0.3 mm; 0: the
/// noise prevents this for any number up to kMostAdvised.
inline int more_heights(const Delta& delta, const Estimate& found, const Linear& of,
                        const Noise& noise, double radius) {
  const double sigma2 = noise.sigma[0] * noise.sigma[0];
  for (int more = 1; more <= kMostAdvised; ++more) {
    const vector<Vector3> at = spread(more, radius);
    Matrix G(of.heights + more, of.G.cols());
    G.topRows(of.heights) = of.G.topRows(of.heights);
    for (int k = 0; k < more; ++k) G.row(of.heights + k) = slopes(delta, found, at[k]).row(2);
    const Matrix added = G.bottomRows(more);
    const Matrix P = (noise.P.inverse() + added.transpose() * added / sigma2).inverse();
    const Vector spare = 1 - (G * P).cwiseProduct(G).rowwise().sum().array() / sigma2;
    vector<double> shows;
    for (const double each : spare)
      shows.push_back(
          detectable(sqrt(sigma2 / each), kDof + spare.sum() - each, int(of.y.size()) + more));
    if (median(shows) <= kError) return more;
  }
  return 0;
}

/// Errors of one set of parameters or calibration method, predicted − read; NaN: no prediction.
struct Residuals {
  string name;
  Vector off;
};
constexpr char kEstimate[] = "estimate with tolerances", kMean[] = "plain mean";

/// Every calibration method on left-out readings. Many readings are left out in parts, since the
/// number of fits is limited. Heights are left out only if the others determine Klipper's
/// parameters; the result is empty if none can be. The estimate's predictions are those of
/// `judged`.
inline vector<Residuals> held_out(const Delta& delta, const Readings& readings,
                                  const Vector& by_klipper, const Vector& nominal,
                                  const Judged& judged) {
  constexpr int kParts = 24;
  const int count = int(readings.size()), H = heights_of(readings), D = count - H;
  const bool spare = adjusted(delta, false).cols() < H;
  vector<Residuals> result;
  if (!spare && D == 0) return result;
  const auto way = [&](const string& name) -> Vector& {
    return result.emplace_back(name, Vector::Constant(count, kNaN)).off;
  };
  const auto fits = [&](const string& name, const Vector& begin, const Matrix& F, int used) {
    Vector& off = way(name);
    const Vector near = fit(delta, begin, Readings(readings.begin(), readings.begin() + used), F);
    for (int kind = !spare; kind < 2; ++kind)
      for (int part = 0; part < min(kind ? D : H, kParts); ++part) {
        Readings by;
        vector<int> out;
        for (int k = 0; k < count; ++k)
          if ((k >= H) == kind && (k - kind * H) % kParts == part)
            out.push_back(k);
          else if (k < used)
            by.push_back(readings[k]);
        const bool fitted = int(by.size()) == used;  // nothing of it is left out
        const Vector e = errors(delta, fitted ? near : fit(delta, near, by, F), readings).off;
        for (const int k : out) off[k] = e[k];
      }
  };
  fits("bed heights alone", nominal, adjusted(delta, false), H);
  if (D)
    fits(delta.rotary ? "Klipper's seven parameters" : "Klipper's nine parameters", by_klipper,
         adjusted(delta, true), count);
  if (D && !delta.rotary) fits("one common arm", nominal, adjusted(delta, false, true), count);
  way(kEstimate).tail(spare ? count : D) = -judged.off.tail(spare ? count : D);
  if (D > 1) {
    double sum = 0;
    for (int k = H; k < count; ++k) sum += readings[k].value;
    Vector& off = way(kMean);
    for (int k = H; k < count; ++k) off[k] = (sum - D * readings[k].value) / (D - 1);
  }
  return result;
}
}  // namespace truepose::printers
