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

#include "truepose/printers/fit.hpp"

namespace truepose::printers {
constexpr double kDof = 3;  ///< ν₀: half of all printers have 0.6 to 1.6 times the assumed noise
constexpr double kFalseAlarm = 0.005;  ///< α: probability of rejecting correct readings
constexpr double kPower = 0.9;         ///< probability of detecting a detectable error
constexpr double kError = 0.3 * kMm;   ///< of one height, detectable for a verdict
constexpr double kLayer = 0.15 * kMm;  ///< noise of the heights that prevents a first layer
constexpr int kMostAdvised = 24;       ///< heights to add

/// P(|T| > t) of Student's t: the incomplete beta function's continued fraction (Abramowitz and
/// Stegun, 26.5.8 and 26.7.1).
inline double student_tails(double t, double dof) {
  const auto beta = [](double x, double a, double b) {
    double value = 1;
    for (int m = 200; m >= 1; --m) {
      const double even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
      const double odd = -(a + m - 1) * (a + b + m - 1) * x / ((a + 2 * m - 2) * (a + 2 * m - 1));
      value = 1 + odd / (1 + even / value);
    }
    return std::exp(a * std::log(x) + b * std::log1p(-x) + std::lgamma(a + b) - std::lgamma(a) -
                    std::lgamma(b)) /
           (a * value);
  };
  const double a = 0.5 * dof, x = dof / (dof + t * t);
  if (!(x > 0) || !(x < 1)) return x > 0 ? 1 : 0;
  return x < (a + 1) / (a + 2.5) ? beta(x, a, 0.5) : 1 - beta(1 - x, 0.5, a);
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
/// P(χ² > x) for any degrees of freedom, by the incomplete gamma function's series (26.4.6).
inline double chi2_tail(double x, double dof) {
  double term = 1, sum = 1;
  if (x > dof + 40 * std::sqrt(dof) + 200) return 0;
  for (double k = dof + 2; term > 1e-17 * sum; k += 2) sum += term *= x / k;
  return 1 - std::exp(0.5 * dof * std::log(0.5 * x) - 0.5 * x - std::lgamma(0.5 * dof + 1)) * sum;
}

/// Noise of heights and of distances, and the estimate at that noise.
struct Noise {
  double sigma[2];  ///< scale of Student's t, m
  double dof[2];    ///< its degrees of freedom
  Vector u;         ///< unknowns, in units of their prior σ
  Matrix P;         ///< their covariance

  double deviation(int kind) const { return sigma[kind] * std::sqrt(dof[kind] / (dof[kind] - 2)); }
};

/// Linear readings y = G u + ε; kind 0 of a height, 1 of a distance.
struct Linear {
  Matrix G;
  Vector y;
  std::vector<int> kind;
};
inline Linear linear(const Delta& delta, const Readings& readings, const Prior& known,
                     const Estimate& found) {
  const Errors e = errors(delta, found.p(), readings, true);
  Linear of{slopes_of(e, found.theta, readings, known, found.free), {}, {}};
  of.y = of.G * found.u - left_over(e, found.theta, readings);
  for (const Reading& each : readings) of.kind.push_back(each.distance);
  return of;
}

/// The noise of linear readings, without one of them, from a start of σ. `assumed`: the prior's
/// centre.
inline Noise noise_of(const Linear& of, const double (&assumed)[2], const double (&start)[2],
                      int without = -1) {
  constexpr int kRounds = 100;
  const auto size = of.G.cols();
  Matrix A[2] = {Matrix::Zero(size, size), Matrix::Zero(size, size)};
  Vector b[2] = {Vector::Zero(size), Vector::Zero(size)};
  double count[2] = {};
  for (int k = 0; k < int(of.kind.size()); ++k) {
    if (k == without) continue;
    const int kind = of.kind[std::size_t(k)];
    A[kind] += of.G.row(k).transpose() * of.G.row(k);
    b[kind] += of.G.row(k).transpose() * of.y[k];
    count[kind] += 1;
  }
  Noise found{{start[0], start[1]}, {}, {}, {}};
  for (int round = 0; round < kRounds; ++round) {
    const double w[2] = {1 / (found.sigma[0] * found.sigma[0]),
                         1 / (found.sigma[1] * found.sigma[1])};
    found.P = (Matrix::Identity(size, size) + w[0] * A[0] + w[1] * A[1]).inverse();
    found.u = found.P * (w[0] * b[0] + w[1] * b[1]);
    double left[2] = {}, change = 0;
    for (int k = 0; k < int(of.kind.size()); ++k)
      if (k != without) {
        const double r = of.y[k] - of.G.row(k).dot(found.u);
        left[of.kind[std::size_t(k)]] += r * r;
      }
    for (int kind = 0; kind < 2; ++kind) {
      found.dof[kind] = kDof + count[kind] - w[kind] * found.P.cwiseProduct(A[kind]).sum();
      const double last = found.sigma[kind];
      found.sigma[kind] =
          std::sqrt((kDof * assumed[kind] * assumed[kind] + left[kind]) / found.dof[kind]);
      change = std::max(change, std::fabs(found.sigma[kind] / last - 1));
    }
    if (change < 1e-4) break;
  }
  return found;
}

/// The error of one of `count` readings that is rejected in 90 % of cases.
inline double detectable(double scale, double dof, int count) {
  return scale * (student_beyond(kFalseAlarm / (2 * count), dof) + student_beyond(1 - kPower, dof));
}
inline double median(std::vector<double> values) {
  if (values.empty()) return kNaN;
  const std::size_t half = values.size() / 2;
  std::sort(values.begin(), values.end());
  return values.size() % 2 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

/// Every reading tested against all others, and its detectability.
struct Judged {
  Noise noise;
  Vector off, scale, dof;  ///< reading − prediction from the others, m; scale of it, of Student's t
  Vector shows;            ///< error of the reading that is rejected in 90 % of cases, m
  int wrong = -1;          ///< the reading rejected by the test, or -1
  double least = 0;        ///< error detectable in half of the heights, m
  bool scattered = false;  ///< the heights' noise exceeds that of a possible first layer, at 99.5 %
};
inline Judged judge(const Linear& of, const Assumed& assumed) {
  const double centre[2] = {assumed.height, assumed.distance};
  const int count = int(of.kind.size());
  Judged judged;
  judged.noise = noise_of(of, centre, centre);
  judged.off = judged.scale = judged.dof = judged.shows = Vector(count);
  double least_chance = kFalseAlarm / count;
  std::vector<double> shows;
  for (int k = 0; k < count; ++k) {
    const int kind = of.kind[std::size_t(k)];
    const Noise by = noise_of(of, centre, judged.noise.sigma, k);
    judged.off[k] = of.y[k] - of.G.row(k).dot(by.u);
    judged.scale[k] = std::sqrt(by.sigma[kind] * by.sigma[kind] +
                                of.G.row(k).dot(by.P * of.G.row(k).transpose()));
    judged.dof[k] = by.dof[kind];
    const double chance = student_tails(judged.off[k] / judged.scale[k], judged.dof[k]);
    if (chance < least_chance) {
      least_chance = chance;
      judged.wrong = k;
    }
    judged.shows[k] = detectable(judged.scale[k], judged.dof[k], count);
    if (kind == 0) shows.push_back(judged.shows[k]);
  }
  judged.least = median(shows);
  const double dof = judged.noise.dof[0], over = judged.noise.sigma[0] / kLayer;
  judged.scattered = chi2_tail(dof * over * over, dof) < kFalseAlarm;
  return judged;
}

/// Evenly spread points of a disc at z = 0.
inline std::vector<Vector3> spread(int count, double radius) {
  std::vector<Vector3> points;
  for (int k = 0; k < count; ++k) {
    const double turn = 180 * kDegree * (3 - std::sqrt(5.0)) * k;
    const double ring = radius * std::sqrt((k + 0.5) / count);
    points.emplace_back(ring * std::cos(turn), ring * std::sin(turn), 0);
  }
  return points;
}
/// Slopes of a height at x by the free unknowns, in units of their prior σ.
inline Vector height_slope(const Delta& delta, const Prior& known, const Estimate& found,
                           const Vector3& x) {
  const Matrix J = delta.slopes(found.p(), x);
  Vector g = Vector::Zero(Eigen::Index(found.free.size()));
  for (std::size_t j = 0; j < found.free.size(); ++j)
    if (found.free[j] < delta.count())
      g[Eigen::Index(j)] = known.sigma[found.free[j]] * J(2, found.free[j]);
  return g;
}
/// How many heights within `radius` to add so that half of all show an error of 0.3 mm; 0: the
/// noise prevents this for any number up to kMostAdvised.
inline int more_heights(const Delta& delta, const Prior& known, const Estimate& found,
                        const Linear& of, const Noise& noise, double radius) {
  const double sigma2 = noise.sigma[0] * noise.sigma[0];
  for (int more = 1; more <= kMostAdvised; ++more) {
    std::vector<Vector> rows;
    for (std::size_t k = 0; k < of.kind.size(); ++k)
      if (of.kind[k] == 0) rows.push_back(of.G.row(Eigen::Index(k)));
    Matrix known_then = noise.P.inverse();
    for (const Vector3& at : spread(more, radius)) {
      rows.push_back(height_slope(delta, known, found, at));
      known_then += rows.back() * rows.back().transpose() / sigma2;
    }
    const Matrix P = known_then.inverse();
    double sum = 0;
    std::vector<double> spare, shows;
    for (const Vector& row : rows) sum += spare.emplace_back(1 - row.dot(P * row) / sigma2);
    for (const double each : spare)
      shows.push_back(
          detectable(std::sqrt(sigma2 / each), kDof + sum - each, int(of.kind.size()) + more));
    if (median(shows) <= kError) return more;
  }
  return 0;
}

/// Errors of one set of parameters or calibration method, predicted − read; NaN: no prediction.
struct Residuals {
  std::string name;
  Vector off;
};
constexpr char kEstimate[] = "estimate with tolerances", kMean[] = "plain mean";

/// Every calibration method on left-out readings. Many readings are left out in parts, since the
/// number of fits is limited. Heights are left out only if the others determine Klipper's
/// parameters; the result is empty if none can be. The estimate's predictions are those of
/// `judged`.
inline std::vector<Residuals> held_out(const Delta& delta, const Readings& readings,
                                       const Vector& by_klipper, const Vector& nominal,
                                       const Judged& judged) {
  constexpr int kParts = 24;
  const int count = int(readings.size()), H = heights_of(readings), D = count - H;
  const bool spare = adjusted(delta, false).cols() < H;
  std::vector<Residuals> result;
  if (!spare && D == 0) return result;
  const auto way = [&](std::string name, const Vector& begin, const Matrix& F, bool heights_alone) {
    Vector off = Vector::Constant(count, kNaN);
    const Vector near = fit(delta, begin, heights_alone ? heights_only(readings) : readings, F);
    for (int kind = 0; kind < 2; ++kind) {
      const int first = kind ? H : 0, of = kind ? D : spare ? H : 0, parts = std::min(of, kParts);
      for (int part = 0; part < parts; ++part) {
        Readings by;
        for (int k = 0; k < (heights_alone ? H : count); ++k)
          if (k < first || k >= first + of || (k - first) % kParts != part)
            by.push_back(readings[std::size_t(k)]);
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
    for (int k = H; k < count; ++k) sum += readings[std::size_t(k)].value;
    for (int k = H; k < count; ++k) {
      const double value = readings[std::size_t(k)].value;
      off[k] = (sum - value) / (D - 1) - value;
    }
    result.push_back({kMean, off});
  }
  return result;
}

/// A mistake in the readings, or empty: impossible, mistyped, or in another unit.
inline std::string mistake(const Printer& printer, const Config& config, const Prior& known,
                           const Assumed& assumed) {
  constexpr double kGross = 1 * kMm, kTimes = 6;  // beyond a calliper's error; and their scatter
  constexpr double kBed = 1 * kMm, kFactor = 0.05;
  const Readings& readings = printer.readings;
  const auto unit = [&](double ratio, const std::string& otherwise) {
    for (const auto& [factor, name] :
         {std::pair(1 / 25.4, "inches"), std::pair(0.1, "cm"), std::pair(1e-3, "m"),
          std::pair(1e3, "µm"), std::pair(25.4, "mm of inches")})
      if (std::fabs(ratio / factor - 1) < kFactor)
        return "in " + std::string(name) + "? Klipper takes mm";
    return otherwise;
  };
  const Errors e = errors(printer.delta, known.mean.head(printer.delta.count()), readings);
  for (Eigen::Index k = 0; k < e.off.size(); ++k)
    if (!std::isfinite(e.off[k]))
      return readings[std::size_t(k)].name + ": the nozzle cannot have been there; " + kChanged +
             ", or are lengths in other units than mm?";
  // A height: with a separate prior, since one gross height shifts the common one.
  const Readings heights = heights_only(readings);
  const auto left = [&](const Readings& by) {
    Printer part = printer;
    part.readings = by;
    const Prior own = prior(part, config, assumed, known.arm);
    return errors(printer.delta, estimate(printer.delta, by, own, assumed).p(), by).off;
  };
  const Vector off = left(heights);
  if (!(rms(off) <= kBed)) {
    std::vector<std::size_t> worst(heights.size());
    for (std::size_t k = 0; k < worst.size(); ++k) worst[k] = k;
    std::sort(worst.begin(), worst.end(), [&](std::size_t a, std::size_t b) {
      return std::fabs(off[Eigen::Index(a)]) > std::fabs(off[Eigen::Index(b)]);
    });
    worst.resize(heights.size() > 3 ? std::min<std::size_t>(worst.size(), 30) : 0);
    double least = 0.2 * rms(off);
    const Reading* wrong = nullptr;
    for (const std::size_t k : worst) {
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
  std::vector<double> ratio, away;
  for (std::size_t k = heights.size(); k < readings.size(); ++k) {
    ratio.push_back(readings[k].value / e.lengths[Eigen::Index(k)]);
    away.push_back(-e.off[Eigen::Index(k)]);
  }
  if (ratio.empty()) return {};
  const double first = e.lengths[Eigen::Index(heights.size())];
  if (std::fabs(median(ratio) - 1) > kFactor)
    return format("distances: %.6g mm, … where the nozzle moved by %.2f mm, …: ",
                  readings[heights.size()].value / kMm, first / kMm) +
           unit(median(ratio), std::string(kChanged) + ", or is a height wrong?");
  const bool many = away.size() > 2;
  const double middle = many ? median(away) : 0;
  std::vector<double> from(away);
  for (double& each : from) each = std::fabs(each - middle);
  const double scatter = many ? 1.4826 * median(from) : 0;
  const std::size_t k = std::size_t(std::max_element(from.begin(), from.end()) - from.begin());
  const Reading& of = readings[heights.size() + k];
  const double length = e.lengths[Eigen::Index(heights.size() + k)];
  if (from[k] > std::max({kGross, kTimes * scatter, many ? 0 : 0.02 * length}))
    return of.name +
           format(" = %.6g: %.2f mm is expected%s: ", of.value / kMm, (length + middle) / kMm,
                  many ? " by the others" : "") +
           unit(ratio[k], "typed wrong?") + " Measure it again, or " + kTakeOut;
  return {};
}
}  // namespace truepose::printers
