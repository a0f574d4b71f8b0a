// Fits of a delta printer to its readings: Klipper's criterion, and the maximum a posteriori one.
//
// Klipper minimises, by coordinate descent,
//
//     Σ (|x(s₁) - x(s₂)| - d)² + w Σ (z(s) - h)²,   w = n_d / (0.5 n_h), or 1 without distances,
//
// for n_d distances and n_h probed heights (klippy/extras/delta_calibrate.py) over radius, two
// angles and three endstops, with distances also three arms. The maximum a posteriori estimate has
// all parameters, each with the σ of its deviation from nominal, which is fixed before any reading.
// A print shrinks and its lines have a width, so a distance reads
//
//     d = (1 - κ) |x(s₁) - x(s₂)| + b,
//
// with unknown κ and b. For distances, κ and the scale of arms and radius are equivalent; only the
// nominal dimensions separate them. Both are minimised by Levenberg-Marquardt. theta has the
// parameters, κ and b, the latter two 0 in Klipper's criterion.
#pragma once

#include "truepose/printers/printer.hpp"

namespace truepose::printers {
constexpr char kChanged[] = "have microsteps or rotation_distance changed since";

/// Assumed σ of build and measurements, the same for all printers; m, rad, κ without unit.
struct Assumed {
  double sigma[TRUEPOSE_PRINTER_SIGMAS];  ///< in the order of truepose/printers.h

  /// Those given, in the units of kSigma, where they are above 0.
  Assumed(const double* given = nullptr) {
    for (int k = 0; k < TRUEPOSE_PRINTER_SIGMAS; ++k)
      sigma[k] = kSigma[k].scale * (given && given[k] > 0 ? given[k] : kSigma[k].usual);
  }
  /// σ of theta; 0: fixed.
  Vector of(const Delta& delta) const {
    Vector all(delta.count() + 2);
    for (int k = 0; const Option& option : options(delta.rotary)) all[k++] = sigma[option.kind];
    all[delta.angle() + 2] = 0;  // tower c defines the axes of x and y
    return all;
  }
  double noise(bool distance) const { return sigma[TRUEPOSE_PRINTER_HEIGHT + distance]; }
  string text() const {
    string all;
    for (int k = 0; k < TRUEPOSE_PRINTER_SIGMAS; ++k)
      all += format("%s%s %g%s%s", k ? ", " : "", kSigma[k].name, sigma[k] / kSigma[k].scale,
                    k == TRUEPOSE_PRINTER_ANGLE ? "" : " ", kSigma[k].unit);
    return all;
  }
};

/// Predictions of theta minus readings, m; NaN at unreachable poses.
struct Errors {
  Vector off;
  Matrix slopes;  ///< by theta, where asked for; 0 at unreachable poses
};
inline Errors errors(const Delta& delta, const Vector& theta, const Readings& readings,
                     bool sloped = false) {
  const int count = int(readings.size()), P = delta.count();
  Errors e{Vector(count), Matrix()};
  if (sloped) e.slopes.setZero(count, P + 2);
  Matrix J[2];
  for (int k = 0; k < count; ++k) {
    const Reading& of = readings[k];
    const Vector3 x = delta.position(theta, of.at[0], sloped ? &J[0] : nullptr);
    if (!of.distance) {
      e.off[k] = x[2] - of.value;
      if (sloped && x.allFinite()) e.slopes.row(k).head(P) = J[0].row(2);
      continue;
    }
    const Vector3 apart = x - delta.position(theta, of.at[1], sloped ? &J[1] : nullptr);
    const double length = apart.norm(), kept = 1 - theta[P];
    e.off[k] = kept * length + theta[P + 1] - of.value;
    if (sloped && apart.allFinite() && length > 0)
      e.slopes.row(k) << kept * apart.transpose() / length * (J[0] - J[1]), -length, 1;
  }
  return e;
}

inline double rms(const Vector& values) {
  return values.size() ? sqrt(values.squaredNorm() / double(values.size())) : kNaN;
}
/// RMS of the finite values alone.
inline double rms_finite(const Vector& values) {
  double sum = 0;
  int count = 0;
  for (const double value : values)
    if (isfinite(value)) sum += value * value, ++count;
  return count ? sqrt(sum / count) : kNaN;
}

/// The u near 0 that minimises |w (prediction(theta + S u) - reading)|² + |prior u|², by
/// Levenberg-Marquardt; a reading out of reach counts as 1 m off. `J`: slopes at the minimum.
inline Vector minimised(const Delta& delta, const Readings& readings, const Vector& theta,
                        const Matrix& S, const Vector& weight, double prior, Matrix& J) {
  constexpr int kRounds = 200;
  const int size = int(S.cols()), count = int(readings.size());
  const auto at = [&](const Vector& u, bool sloped) {
    const Errors e = errors(delta, theta + S * u, readings, sloped);
    Vector r(count + size);
    r << weight.cwiseProduct(e.off.array().isFinite().select(e.off, 1).matrix()), prior * u;
    if (sloped) {
      J.resize(count + size, size);
      J << weight.asDiagonal() * e.slopes * S, prior * Matrix::Identity(size, size);
    }
    return r;
  };
  Vector u = Vector::Zero(size), r = at(u, true);
  double damping = 1e-4, now = r.squaredNorm();
  for (int round = 0; round < kRounds && damping < 1e12; ++round) {
    Vector scale = J.colwise().norm();
    const double most = size ? scale.maxCoeff() : 0;
    if (!(most > 0)) break;
    scale = scale.cwiseMax(1e-12 * most);
    Matrix A(J.rows() + size, size);
    A << J * scale.cwiseInverse().asDiagonal(), sqrt(damping) * Matrix::Identity(size, size);
    Vector b = Vector::Zero(A.rows());
    b.head(r.size()) = -r;
    const Vector step = Vector(A.householderQr().solve(b)).cwiseQuotient(scale);
    const double then = at(u + step, false).squaredNorm();
    if (then < now) {
      u += step;
      const bool close = now - then <= 1e-15 * now;
      r = at(u, true);
      now = then;
      damping = max(0.1 * damping, 1e-14);
      if (close) break;
    } else {
      if (step.cwiseProduct(scale).norm() <= 1e-12 * sqrt(now)) break;
      damping *= damping < 1e-6 ? 100 : 10;
    }
  }
  return u;
}

/// Roots of Klipper's weights of the squared errors.
inline Vector klipper_weights(const Readings& readings) {
  double distances = 0, probed = 0;
  for (const Reading& of : readings) distances += of.distance, probed += of.probed;
  Vector weights = Vector::Ones(readings.size());
  if (distances > 0)
    weights.head(heights_of(readings)).setConstant(sqrt(distances / (0.5 * max(probed, 1.0))));
  return weights;
}
inline double klipper_cost(const Delta& delta, const Vector& theta, const Readings& readings) {
  return errors(delta, theta, readings).off.cwiseProduct(klipper_weights(readings)).squaredNorm();
}

/// theta that minimises Klipper's criterion over start + F u.
inline Vector fit(const Delta& delta, const Vector& start, const Readings& readings,
                  const Matrix& F) {
  Matrix J;
  return start + F * minimised(delta, readings, start, F, klipper_weights(readings), 0, J);
}

/// Columns of theta that Klipper adjusts, with distances (extended) or without; `common`: the rods
/// together as one unknown more.
inline Matrix adjusted(const Delta& delta, bool extended, bool common = false) {
  vector<int> free;
  const auto some = [&](int first, int count) {
    for (int k = 0; k < count; ++k) free.push_back(first + k);
  };
  some(delta.endstop(), 3);
  some(delta.rotary, 1);
  if (!delta.rotary || extended) some(delta.angle(), 2);
  if (extended) some(delta.rotary ? 0 : delta.rod(), delta.rotary ? 1 : 3);
  Matrix F = Matrix::Zero(delta.count() + 2, free.size() + common);
  for (size_t k = 0; k < free.size(); ++k) F(free[k], k) = 1;
  if (common) F.col(F.cols() - 1).segment<3>(delta.rod()).setOnes();
  return F;
}
/// Prior of the parameters, and of κ and b.
struct Prior {
  Vector mean, sigma;  ///< of p, κ, b; σ 0: fixed
  double arm = 0;      ///< nominal length of the arms (of a rotary delta, the lower ones), m
  string arm_said;     ///< source of that length
};

/// A parameter's commented-out value, if plausible, else NaN. `prefix` of options that keep a
/// rotary delta's nominal values: SAVE_CONFIG itself comments out roughly set ones, such as
/// endstops.
constexpr char kNominal[] = "drawn_";
inline double replaced(const Config& config, const Option& of, double now,
                       const char* prefix = "") {
  const auto at = config.off.find({of.section, prefix + of.option});
  const double value = at == config.off.end() ? kNaN : of.scale() * at->second;
  return value > 0.5 * now && value < 2 * now ? value : kNaN;
}

/// Towers are a third of a turn apart. A linear delta's radius and endstops have no nominal value:
/// they follow from the heights with nominal arms, and their σ is much wider than the heights
/// allow. All else is as in the file. `arm`, m, is the nominal length of the arms if it is above 0.
inline Prior prior(const Printer& printer, const Config& config, const Assumed& assumed,
                   double arm) {
  const Delta& delta = printer.delta;
  Prior known{printer.theta, assumed.of(delta), arm, "--arm"};
  const auto option = [&](int k) -> const Option& { return printer.options[k]; };
  if (!(arm > 0)) {
    bool by_hand = false;
    for (int k = delta.rod(); k < delta.rod() + 3; ++k) {
      const auto saved = config.saved.find(option(k).section);
      by_hand =
          by_hand || (config.has(option(k).section, option(k).option) &&
                      (saved == config.saved.end() || !saved->second.contains(option(k).option)));
    }
    known.arm = kNaN;
    for (int k = delta.rod(); k < delta.rod() + 3 && !by_hand && isnan(known.arm); ++k) {
      known.arm = replaced(config, option(k), printer.theta[k]);
      known.arm_said =
          "[" + option(k).section + "] " + option(k).option + " before it was replaced";
    }
    if (isnan(known.arm)) {
      Vector3 rods = printer.theta.segment<3>(delta.rod());
      std::sort(rods.begin(), rods.end());
      known.arm = rods[1];
      known.arm_said = rods[0] == rods[2] ? "the file, which has one for all"
                                          : "the middle one of the file's: --arm says better";
    }
  }
  known.mean.segment<3>(delta.rod()).setConstant(known.arm);
  known.mean.segment<3>(delta.angle()) =
      Vector3(120, 240, 0) * kDegree + Vector3::Constant(printer.theta[delta.angle() + 2]);
  for (int k = 0; k < delta.count(); ++k) {
    if (const double nominal = replaced(config, option(k), printer.theta[k], kNominal);
        !isnan(nominal))
      known.mean[k] = nominal;
    if (option(k).angle()) {  // as many whole turns as in the file
      const double turn = 360 * kDegree;
      known.mean[k] += turn * std::nearbyint((printer.theta[k] - known.mean[k]) / turn);
    }
  }
  const Readings heights = heights_only(printer.readings);
  if (!delta.rotary && !heights.empty()) {
    Matrix F = Matrix::Zero(delta.count() + 2, 4);
    F(0, 0) = 1;
    F.block<3, 3>(delta.endstop(), 1).setIdentity();
    known.mean = fit(delta, known.mean, heights, F);
  }
  return known;
}

/// The nominal values that a file with the estimate must keep for prior(): otherwise the estimate
/// would become the next nominal, and the same readings would count twice.
inline vector<pair<Place, double>> nominal_to_keep(const Prior& known, const Printer& printer) {
  const Delta& delta = printer.delta;
  vector<pair<Place, double>> kept;
  for (int k = 0; k < delta.count(); ++k) {
    const Option& of = printer.options[k];
    const double mean = std::nearbyint(known.mean[k] / of.scale() * 1e6) * 1e-6;
    const bool rod = k >= delta.rod() && k < delta.rod() + 3;
    if (k == delta.rod())
      kept.push_back({{of.section, of.option}, std::nearbyint(known.arm / kMm * 1e6) * 1e-6});
    else if (delta.rotary && known.sigma[k] > 0 && !of.angle() && !rod)
      kept.push_back({{of.section, kNominal + of.option}, mean});
  }
  return kept;
}

/// Maximum a posteriori unknowns and their uncertainty.
struct Estimate {
  Vector theta;
  Matrix covariance;  ///< of theta
  Vector u;           ///< of the free ones: deviation from the prior's mean in units of its σ
  Matrix P, S;        ///< covariance of u; theta = mean + S u
};
inline Estimate estimate(const Delta& delta, const Readings& readings, const Prior& known,
                         const Assumed& noise) {
  Estimate found;
  Vector weight(readings.size());
  for (int k = 0; k < weight.size(); ++k) weight[k] = 1 / noise.noise(readings[k].distance);
  const int size = int((known.sigma.array() > 0).count());
  found.S.setZero(known.sigma.size(), size);
  for (int k = 0, j = 0; k < known.sigma.size(); ++k)
    if (known.sigma[k] > 0) found.S(k, j++) = known.sigma[k];
  Matrix J;
  found.u = minimised(delta, readings, known.mean, found.S, weight, 1, J);
  found.theta = known.mean + found.S * found.u;
  found.P = (J.transpose() * J).inverse();
  found.covariance = found.S * found.P * found.S.transpose();
  return found;
}
}  // namespace truepose::printers
