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
inline Noise noise_of(Linear of, const Assumed& assumed, const double* start, int without = -1) {
  constexpr int kRounds = 100;
  const auto size = of.G.cols();
  double count[2] = {double(of.heights), double(of.y.size() - of.heights)};
  if (without >= 0) {
    of.G.row(without).setZero();
    of.y[without] = 0;
    --count[without >= of.heights];
  }
  const Matrix G[2] = {of.G.topRows(of.heights), of.G.bottomRows(of.y.size() - of.heights)};
  const Vector y[2] = {of.y.head(of.heights), of.y.tail(of.y.size() - of.heights)};
  const Matrix A[2] = {G[0].transpose() * G[0], G[1].transpose() * G[1]};
  Noise found{{start[0], start[1]}, {}, {}, {}};
  for (int round = 0; round < kRounds; ++round) {
    const double w[2] = {pow(found.sigma[0], -2), pow(found.sigma[1], -2)};
    found.P = (Matrix::Identity(size, size) + w[0] * A[0] + w[1] * A[1]).inverse();
    found.u = found.P * (w[0] * G[0].transpose() * y[0] + w[1] * G[1].transpose() * y[1]);
    double change = 0;
    for (int kind = 0; kind < 2; ++kind) {
      found.dof[kind] = kDof + count[kind] - w[kind] * found.P.cwiseProduct(A[kind]).sum();
      const double last = found.sigma[kind], left = (y[kind] - G[kind] * found.u).squaredNorm();
      found.sigma[kind] = sqrt((kDof * pow(assumed.noise(kind), 2) + left) / found.dof[kind]);
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
inline double median(vector<double> values) {
  if (values.empty()) return kNaN;
  const size_t half = values.size() / 2;
  std::sort(values.begin(), values.end());
  return values.size() % 2 ? values[half] : 0.5 * (values[half - 1] + values[half]);
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
    vector<Vector> rows;
    for (int k = 0; k < of.heights; ++k) rows.push_back(of.G.row(k));
    Matrix known_then = noise.P.inverse();
    for (const Vector3& at : spread(more, radius)) {
      rows.push_back(slopes(delta, found, at).row(2));
      known_then += rows.back() * rows.back().transpose() / sigma2;
    }
    const Matrix P = known_then.inverse();
    double sum = 0;
    vector<double> spare, shows;
    for (const Vector& row : rows) sum += spare.emplace_back(1 - row.dot(P * row) / sigma2);
    for (const double each : spare)
      shows.push_back(detectable(sqrt(sigma2 / each), kDof + sum - each, int(of.y.size()) + more));
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
  const auto way = [&](string name, const Vector& begin, const Matrix& F, bool heights_alone) {
    Vector off = Vector::Constant(count, kNaN);
    const Vector near = fit(delta, begin, heights_alone ? heights_only(readings) : readings, F);
    for (int kind = 0; kind < 2; ++kind) {
      const int first = kind ? H : 0, of = kind ? D : spare ? H : 0, parts = min(of, kParts);
      for (int part = 0; part < parts; ++part) {
        Readings by;
        for (int k = 0; k < (heights_alone ? H : count); ++k)
          if (k < first || k >= first + of || (k - first) % kParts != part)
            by.push_back(readings[k]);
        const Vector p = heights_alone && kind ? near : fit(delta, near, by, F);
        const Errors e = errors(delta, p, readings);
        for (int k = part; k < of; k += kParts) off[first + k] = e.off[first + k];
      }
    }
    result.push_back({std::move(name), std::move(off)});
  };
  way("bed heights alone", nominal, adjusted(delta, false), true);
  if (D)
    way(delta.rotary ? "Klipper's seven parameters" : "Klipper's nine parameters", by_klipper,
        adjusted(delta, true), false);
  if (D && !delta.rotary) way("one common arm", nominal, adjusted(delta, false, true), false);
  Vector own = -judged.off;
  if (!spare) own.head(H).setConstant(kNaN);
  result.push_back({kEstimate, own});
  if (D > 1) {
    Vector off = Vector::Constant(count, kNaN);
    double sum = 0;
    for (int k = H; k < count; ++k) sum += readings[k].value;
    for (int k = H; k < count; ++k) {
      const double value = readings[k].value;
      off[k] = (sum - value) / (D - 1) - value;
    }
    result.push_back({kMean, off});
  }
  return result;
}

/// A mistake in the readings, or empty: impossible, mistyped, or in another unit.
inline string mistake(const Printer& printer, const Config& config, const Prior& known,
                      const Assumed& assumed) {
  constexpr double kGross = 1 * kMm, kTimes = 6;  // beyond a calliper's error; and their scatter
  constexpr double kBed = 1 * kMm, kFactor = 0.05;
  constexpr size_t kMany = 30;  // heights, of which a gross one alone is far off
  const Readings& readings = printer.readings;
  const auto unit = [&](double ratio, const string& otherwise) {
    for (const auto& [factor, name] : {pair(1 / 25.4, "inches"), pair(0.1, "cm"), pair(1e-3, "m"),
                                       pair(1e3, "µm"), pair(25.4, "mm of inches")})
      if (fabs(ratio / factor - 1) < kFactor) return "in " + string(name) + "? Klipper takes mm";
    return otherwise;
  };
  const Errors e = errors(printer.delta, known.mean, readings);
  for (int k = 0; k < e.off.size(); ++k)
    if (!isfinite(e.off[k]))
      return readings[k].name + ": the nozzle cannot have been there; " + kChanged +
             ", or are lengths in other units than mm?";
  // A height: with a separate prior, since one gross height shifts the common one.
  const Readings heights = heights_only(readings);
  const auto left = [&](const Readings& by) {
    Printer part = printer;
    part.readings = by;
    const Prior own = prior(part, config, assumed, known.arm);
    return errors(printer.delta, estimate(printer.delta, by, own, assumed).theta, by).off;
  };
  const Vector off = left(heights);
  if (!(rms(off) <= kBed)) {
    double least = 0.2 * rms(off);
    const Reading* wrong = nullptr;
    for (size_t k = 0; k < heights.size() && heights.size() > 3; ++k) {
      if (heights.size() > kMany && fabs(off[k]) < 2 * rms(off)) continue;
      Readings by = heights;
      by.erase(by.begin() + std::ptrdiff_t(k));
      if (const double now = rms(left(by)); now < least) {
        least = now;
        wrong = &readings[k];
      }
    }
    if (wrong)
      return wrong->name + format(
                               " = %.6g: does not fit the other heights: typed wrong? Measure it "
                               "again, or %s",
                               wrong->value / kMm, kTakeOut);
  }
  // A distance.
  vector<double> ratio, away, length;
  for (size_t k = heights.size(); k < readings.size(); ++k) {
    away.push_back(-e.off[k]);
    length.push_back(readings[k].value + e.off[k]);
    ratio.push_back(readings[k].value / length.back());
  }
  if (ratio.empty()) return {};
  if (fabs(median(ratio) - 1) > kFactor)
    return format("distances: %.6g mm, … where the nozzle moved by %.2f mm, …: ",
                  readings[heights.size()].value / kMm, length[0] / kMm) +
           unit(median(ratio), string(kChanged) + ", or is a height wrong?");
  const bool many = away.size() > 2;
  const double middle = many ? median(away) : 0;
  vector<double> from(away);
  for (double& each : from) each = fabs(each - middle);
  const double scatter = many ? 1.4826 * median(from) : 0;
  const auto k = std::max_element(from.begin(), from.end()) - from.begin();
  const Reading& of = readings[heights.size() + k];
  if (from[k] > max({kGross, kTimes * scatter, many ? 0 : 0.02 * length[k]}))
    return of.name +
           format(" = %.6g: %.2f mm is expected%s: ", of.value / kMm, (length[k] + middle) / kMm,
                  many ? " by the others" : "") +
           unit(ratio[k], "typed wrong?") + " Measure it again, or " + kTakeOut;
  return {};
}
}  // namespace truepose::printers
