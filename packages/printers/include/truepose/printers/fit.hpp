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
// nominal dimensions separate them. Both are minimised by Levenberg-Marquardt.
#pragma once

#include "truepose/printers/printer.hpp"

namespace truepose::printers {
constexpr char kChanged[] = "have microsteps or rotation_distance changed since";

/// Assumed σ of build and measurements, the same for all printers; m, rad, κ without unit.
struct Assumed {
  double arm = 0.5 * kMm;         ///< of each rod or arm from nominal
  double angle = 0.25 * kDegree;  ///< of towers a and b against c: 0.7 mm on 160
  double radius = 5 * kMm;        ///< includes the nacelle's own radius; no nominal value
  double endstop = 2 * kMm;       ///< and height of a rotary delta's shoulders
  double height = 0.04 * kMm;     ///< of probe and flatness of the bed; re-estimated
  double distance = 0.04 * kMm;   ///< of a calliper on a print; re-estimated
  double shrinkage = 0.002;       ///< κ
  double width = 0.05 * kMm;      ///< b: remaining error of the pillars' widths

  /// σ of Klipper's parameters, then of κ and b; 0: fixed.
  Vector of(const Delta& delta) const {
    Vector sigma(delta.count() + 2);
    sigma[0] = delta.rotary ? arm : radius;
    if (delta.rotary) {
      sigma[1] = endstop;
      sigma.segment<3>(delta.upper()).setConstant(arm);
    }
    sigma.segment<3>(delta.angle()) << angle, angle, 0;  // tower c defines the axes of x and y
    sigma.segment<3>(delta.rod()).setConstant(arm);
    sigma.segment<3>(delta.endstop()).setConstant(endstop);
    sigma.tail<2>() << shrinkage, width;
    return sigma;
  }
  /// All, in the order of truepose/printers.h; those not above 0 stay.
  void set(const double* sigma) {
    double* const each[] = {&arm,    &angle,    &radius,    &endstop,
                            &height, &distance, &shrinkage, &width};
    for (std::size_t k = 0; k < std::size(each); ++k)
      if (sigma[k] > 0) *each[k] = sigma[k];
  }
  double noise(const Reading& of) const { return of.distance ? distance : height; }
  std::string text() const {
    return format(
        "arm %g mm, angle %g°, radius %g mm, endstop %g mm, height %g mm, distance %g mm, "
        "shrinkage %g %%, width %g mm",
        arm / kMm, angle / kDegree, radius / kMm, endstop / kMm, height / kMm, distance / kMm,
        100 * shrinkage, width / kMm);
  }
};

/// Predictions of parameters minus readings, m; NaN at unreachable poses.
struct Errors {
  Vector off, lengths;  ///< lengths between a distance's ends; of a height 0
  Matrix slopes;        ///< of the predictions by p, where asked for; 0 at unreachable poses

  bool finite() const { return off.allFinite(); }
};
inline Errors errors(const Delta& delta, const Vector& p, const Readings& readings,
                     bool sloped = false) {
  const auto count = Eigen::Index(readings.size());
  Errors e{Vector(count), Vector::Zero(count), Matrix()};
  if (sloped) e.slopes.setZero(count, delta.count());
  Matrix J[2];
  for (Eigen::Index k = 0; k < count; ++k) {
    const Reading& of = readings[std::size_t(k)];
    const Vector3 x = delta.position(p, of.at[0], sloped ? &J[0] : nullptr);
    if (!of.distance) {
      e.off[k] = x[2] - of.value;
      if (sloped && x.allFinite()) e.slopes.row(k) = J[0].row(2);
      continue;
    }
    const Vector3 apart = x - delta.position(p, of.at[1], sloped ? &J[1] : nullptr);
    e.lengths[k] = apart.norm();
    e.off[k] = e.lengths[k] - of.value;
    if (sloped && apart.allFinite() && e.lengths[k] > 0)
      e.slopes.row(k) = apart.transpose() / e.lengths[k] * (J[0] - J[1]);
  }
  return e;
}

inline double rms(const Vector& values) {
  return values.size() ? std::sqrt(values.squaredNorm() / double(values.size())) : kNaN;
}
/// RMS of the finite values alone.
inline double rms_finite(const Vector& values) {
  double sum = 0;
  int count = 0;
  for (const double value : values)
    if (std::isfinite(value)) sum += value * value, ++count;
  return count ? std::sqrt(sum / count) : kNaN;
}

/// The u near 0 that minimises |r(u)|², by Levenberg-Marquardt. `at(u, r, J)` sets residuals and,
/// unless null, slopes; unreachable residuals are NaN and count as 1 each.
template <class At>
Vector minimised(Eigen::Index size, At&& at) {
  constexpr int kRounds = 200;
  const auto cost = [](const Vector& r) {
    double sum = 0;
    for (const double each : r) sum += std::isfinite(each) ? each * each : 1;
    return sum;
  };
  Vector u = Vector::Zero(size), r, tried;
  Matrix J;
  double damping = 1e-4;
  at(u, r, &J);
  double now = cost(r);
  for (int round = 0; round < kRounds && damping < 1e12; ++round) {
    Vector scale = J.colwise().norm();
    const double most = scale.size() ? scale.maxCoeff() : 0;
    if (!(most > 0)) break;
    scale = scale.cwiseMax(1e-12 * most);
    Matrix A(J.rows() + size, size);
    A << J * scale.cwiseInverse().asDiagonal(), std::sqrt(damping) * Matrix::Identity(size, size);
    Vector b = Vector::Zero(A.rows());
    for (Eigen::Index k = 0; k < r.size(); ++k) b[k] = std::isfinite(r[k]) ? -r[k] : 0;
    const Vector step = Vector(A.householderQr().solve(b)).cwiseQuotient(scale);
    at(u + step, tried, nullptr);
    const double then = cost(tried);
    if (then < now) {
      u += step;
      const bool close = now - then <= 1e-15 * now;
      at(u, r, &J);
      now = then;
      damping = std::max(0.1 * damping, 1e-14);
      if (close) break;
    } else {
      if (step.cwiseProduct(scale).norm() <= 1e-12 * std::sqrt(now)) break;
      damping *= damping < 1e-6 ? 100 : 10;
    }
  }
  return u;
}

/// Klipper's weight of a height's squared error.
inline double klipper_weight(const Readings& readings) {
  double distances = 0, probed = 0;
  for (const Reading& of : readings) distances += of.distance, probed += of.probed;
  return distances > 0 ? distances / (0.5 * std::max(probed, 1.0)) : 1;
}
inline double klipper_cost(const Delta& delta, const Vector& p, const Readings& readings) {
  const Errors e = errors(delta, p, readings);
  const double w = klipper_weight(readings);
  double sum = 0;
  for (std::size_t k = 0; k < readings.size(); ++k)
    sum += (readings[k].distance ? 1 : w) * e.off[Eigen::Index(k)] * e.off[Eigen::Index(k)];
  return sum;
}

/// Parameters that minimise Klipper's criterion over start + F u.
inline Vector fit(const Delta& delta, const Vector& start, const Readings& readings,
                  const Matrix& F) {
  const double root = std::sqrt(klipper_weight(readings));
  Vector weight(Eigen::Index(readings.size()));
  for (std::size_t k = 0; k < readings.size(); ++k)
    weight[Eigen::Index(k)] = readings[k].distance ? 1 : root;
  return start + F * minimised(F.cols(), [&](const Vector& u, Vector& r, Matrix* J) {
                   const Errors e = errors(delta, start + F * u, readings, J != nullptr);
                   r = weight.cwiseProduct(e.off);
                   if (J) *J = weight.asDiagonal() * e.slopes * F;
                 });
}

/// Columns of p that Klipper adjusts, with distances (extended) or without; `common`: the rods
/// together as one unknown more.
inline Matrix adjusted(const Delta& delta, bool extended, bool common = false) {
  std::vector<int> free;
  const auto some = [&](int first, int count) {
    for (int k = 0; k < count; ++k) free.push_back(first + k);
  };
  some(delta.endstop(), 3);
  some(delta.rotary ? 1 : 0, 1);
  if (!delta.rotary || extended) some(delta.angle(), 2);
  if (delta.rotary && extended) some(0, 1);
  if (!delta.rotary && extended) some(delta.rod(), 3);
  Matrix F = Matrix::Zero(delta.count(), Eigen::Index(free.size()) + common);
  for (std::size_t k = 0; k < free.size(); ++k) F(free[k], Eigen::Index(k)) = 1;
  if (common) F.col(F.cols() - 1).segment<3>(delta.rod()).setOnes();
  return F;
}
/// The parameters that Klipper finds from its starting values.
inline Vector klipper_fit(const Delta& delta, const Vector& start, const Readings& readings) {
  const bool extended = heights_of(readings) < int(readings.size());
  return fit(delta, start, readings, adjusted(delta, extended));
}

/// Prior of the parameters, and of κ and b.
struct Prior {
  Vector mean, sigma;    ///< of p, κ, b; σ 0: fixed
  double arm = 0;        ///< nominal length of the arms (of a rotary delta, the lower ones), m
  std::string arm_said;  ///< source of that length
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
  const std::vector<Option> all = options(delta.rotary);
  Prior known{printer.p, assumed.of(delta), arm, "--arm"};
  const auto option = [&](int k) -> const Option& { return all[std::size_t(k)]; };
  if (!(arm > 0)) {
    bool by_hand = false;
    for (int k = delta.rod(); k < delta.rod() + 3; ++k) {
      const auto saved = config.saved.find(option(k).section);
      by_hand =
          by_hand || (config.has(option(k).section, option(k).option) &&
                      (saved == config.saved.end() || !saved->second.contains(option(k).option)));
    }
    known.arm = kNaN;
    for (int k = delta.rod(); k < delta.rod() + 3 && !by_hand && std::isnan(known.arm); ++k) {
      known.arm = replaced(config, option(k), printer.p[k]);
      known.arm_said =
          "[" + option(k).section + "] " + option(k).option + " before it was replaced";
    }
    if (std::isnan(known.arm)) {
      Vector3 rods = printer.p.segment<3>(delta.rod());
      std::sort(rods.begin(), rods.end());
      known.arm = rods[1];
      known.arm_said = rods[0] == rods[2] ? "the file, which has one for all"
                                          : "the middle one of the file's: --arm says better";
    }
  }
  known.mean.segment<3>(delta.rod()).setConstant(known.arm);
  known.mean.segment<3>(delta.angle()) =
      Vector3(120, 240, 0) * kDegree + Vector3::Constant(printer.p[delta.angle() + 2]);
  for (int k = 0; k < delta.count(); ++k) {
    if (const double nominal = replaced(config, option(k), printer.p[k], kNominal);
        !std::isnan(nominal))
      known.mean[k] = nominal;
    if (option(k).angle) {  // as many whole turns as in the file
      const double turn = 360 * kDegree;
      known.mean[k] += turn * std::nearbyint((printer.p[k] - known.mean[k]) / turn);
    }
  }
  const Readings heights = heights_only(printer.readings);
  if (!delta.rotary && !heights.empty()) {
    Matrix F = Matrix::Zero(delta.count(), 4);
    F(0, 0) = 1;
    F.block<3, 3>(delta.endstop(), 1).setIdentity();
    known.mean = fit(delta, known.mean, heights, F);
  }
  known.mean.conservativeResize(delta.count() + 2);
  known.mean.tail<2>().setZero();
  return known;
}

/// The nominal values that a file with the estimate must keep for prior(): otherwise the estimate
/// would become the next nominal, and the same readings would count twice.
inline std::vector<std::pair<Place, double>> nominal_to_keep(const Prior& known,
                                                             const Delta& delta) {
  std::vector<std::pair<Place, double>> kept;
  const std::vector<Option> all = options(delta.rotary);
  for (int k = 0; k < delta.count(); ++k) {
    const Option& of = all[std::size_t(k)];
    const double mean = std::nearbyint(known.mean[k] / of.scale() * 1e6) * 1e-6;
    const bool rod = k >= delta.rod() && k < delta.rod() + 3;
    if (k == delta.rod())
      kept.push_back({{of.section, of.option}, std::nearbyint(known.arm / kMm * 1e6) * 1e-6});
    else if (delta.rotary && known.sigma[k] > 0 && !of.angle && !rod)
      kept.push_back({{of.section, kNominal + of.option}, mean});
  }
  return kept;
}

/// Maximum a posteriori parameters and their uncertainty.
struct Estimate {
  Vector theta;       ///< p, κ, b
  Matrix covariance;  ///< of theta
  Vector u;           ///< of the free ones: deviation from the prior's mean in units of its σ
  Matrix P;           ///< covariance of u
  std::vector<int> free;

  Vector p() const { return theta.head(theta.size() - 2); }
  double shrinkage() const { return theta[theta.size() - 2]; }
  double width() const { return theta[theta.size() - 1]; }
};

/// Slopes of the predicted readings by the free unknowns, in units of their prior σ.
inline Matrix slopes_of(const Errors& e, const Vector& theta, const Readings& readings,
                        const Prior& known, const std::vector<int>& free) {
  Matrix G(e.slopes.rows(), Eigen::Index(free.size()));
  const auto p = theta.size() - 2;
  for (Eigen::Index k = 0; k < G.rows(); ++k) {
    const bool distance = readings[std::size_t(k)].distance;
    for (Eigen::Index j = 0; j < G.cols(); ++j) {
      const int at = free[std::size_t(j)];
      const double own = at < p    ? (distance ? 1 - theta[p] : 1) * e.slopes(k, at)
                         : at == p ? (std::isfinite(e.lengths[k]) ? -e.lengths[k] : 0)
                                   : double(distance);
      G(k, j) = own * known.sigma[at];
    }
  }
  return G;
}
/// Predictions minus readings, with κ and b.
inline Vector left_over(const Errors& e, const Vector& theta, const Readings& readings) {
  Vector off = e.off;
  for (Eigen::Index k = 0; k < off.size(); ++k)
    if (readings[std::size_t(k)].distance)
      off[k] += theta[theta.size() - 1] - theta[theta.size() - 2] * e.lengths[k];
  return off;
}

inline Estimate estimate(const Delta& delta, const Readings& readings, const Prior& known,
                         const Assumed& noise) {
  Estimate found;
  for (int k = 0; k < known.sigma.size(); ++k)
    if (known.sigma[k] > 0) found.free.push_back(k);
  const auto size = Eigen::Index(found.free.size()), count = Eigen::Index(readings.size());
  Vector weight(count);
  for (Eigen::Index k = 0; k < count; ++k) weight[k] = 1 / noise.noise(readings[std::size_t(k)]);
  const auto theta_at = [&](const Vector& u) {
    Vector theta = known.mean;
    for (Eigen::Index j = 0; j < size; ++j)
      theta[found.free[std::size_t(j)]] += known.sigma[found.free[std::size_t(j)]] * u[j];
    return theta;
  };
  const auto at = [&](const Vector& u, Vector& r, Matrix* J) {
    const Vector theta = theta_at(u);
    const Errors e = errors(delta, theta.head(delta.count()), readings, J != nullptr);
    r.resize(count + size);
    r << weight.cwiseProduct(left_over(e, theta, readings)), u;
    for (double& each : r)  // far beyond any error, yet less than a worse fit of all
      if (!std::isfinite(each)) each = 1e6;
    if (!J) return;
    J->resize(count + size, size);
    *J << weight.asDiagonal() * slopes_of(e, theta, readings, known, found.free),
        Matrix::Identity(size, size);
  };
  found.u = minimised(size, at);
  found.theta = theta_at(found.u);
  Vector r;
  Matrix J;
  at(found.u, r, &J);
  found.P = (J.transpose() * J).inverse();
  found.covariance.setZero(found.theta.size(), found.theta.size());
  for (Eigen::Index i = 0; i < size; ++i)
    for (Eigen::Index j = 0; j < size; ++j) {
      const int a = found.free[std::size_t(i)], b = found.free[std::size_t(j)];
      found.covariance(a, b) = known.sigma[a] * known.sigma[b] * found.P(i, j);
    }
  return found;
}
}  // namespace truepose::printers
