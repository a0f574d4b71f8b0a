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

inline double rms(const Vector& values) { return sqrt(values.array().square().mean()); }
/// RMS of the finite values alone.
inline double rms_finite(const Vector& values) {
  const auto finite = values.array().isFinite();
  return sqrt(finite.select(values.array().square(), 0).sum() / double(finite.count()));
}

/// The u near 0 that minimises |w (prediction(theta + S u) - reading)|² + |prior u|², by
/// Levenberg-Marquardt; a reading out of reach counts as 1 m off. `J`: slopes at the minimum.
inline Vector minimised(const Delta& delta, const Readings& readings, const Vector& theta,
                        const Matrix& S, const Vector& weight, double prior, Matrix& J) {
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
  for (int round = 0; round < 200 && damping < 1e12; ++round) {
    const double most = J.norm();
    if (!(most > 0)) break;
    Matrix A(J.rows() + size, size);
    A << J, sqrt(damping) * most * Matrix::Identity(size, size);
    Vector b = Vector::Zero(A.rows());
    b.head(r.size()) = -r;
    const Vector step = A.householderQr().solve(b);
    const double then = at(u + step, false).squaredNorm();
    if (then < now) {
      u += step;
      const bool close = now - then <= 1e-15 * now;
      r = at(u, true);
      now = then;
      damping = max(0.1 * damping, 1e-14);
      if (close) break;
    } else {
      if (most * step.norm() <= 1e-12 * sqrt(now)) break;
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

/// theta that minimises Klipper's criterion over start + F u.
inline Vector fit(const Delta& delta, const Vector& start, const Readings& readings,
                  const Matrix& F) {
  Matrix J;
  return start + F * minimised(delta, readings, start, F, klipper_weights(readings), 0, J);
}

/// Columns of theta that Klipper adjusts, with distances (extended) or without; `common`: the rods
/// together as one unknown more.
inline Matrix adjusted(const Delta& delta, bool extended, bool common = false) {
  const int angle = delta.angle(), rod = delta.rod(), end = delta.endstop();
  vector<int> free{end, end + 1, end + 2, delta.rotary};  // radius, or a rotary delta's height
  if (!delta.rotary || extended) free.insert(free.end(), {angle, angle + 1});
  if (extended && delta.rotary) free.push_back(0);
  if (extended && !delta.rotary) free.insert(free.end(), {rod, rod + 1, rod + 2});
  const Matrix all = Matrix::Identity(delta.count() + 2, delta.count() + 2);
  Matrix F(all.rows(), free.size() + common);
  F.leftCols(free.size()) = all(Eigen::all, free);
  if (common) F.rightCols(1) = all.middleCols(rod, 3).rowwise().sum();
  return F;
}

/// Prior of the parameters, and of κ and b.
struct Prior {
  Vector mean, sigma;  ///< of p, κ, b; σ 0: fixed
};

/// Towers are a third of a turn apart. A linear delta's radius and endstops have no nominal value:
/// they follow from the heights with nominal arms, and their σ is much wider than the heights
/// allow. All else is as in the file.
inline Prior prior(const Printer& printer) {
  const Delta& delta = printer.delta;
  Prior known{printer.theta, printer.assumed.of(delta)};
  known.mean.segment<3>(delta.rod()).setConstant(printer.arm);
  for (int k = 0; k < delta.count(); ++k) {
    const bool angle = printer.options[k].angle();
    double& mean = known.mean[k];
    if (angle) mean = known.mean[delta.angle() + 2] + 120 * kDegree * (k - delta.angle() + 1);
    if (!isnan(printer.nominal[k])) mean = printer.nominal[k];
    if (angle)  // as many whole turns as in the file
      mean = printer.theta[k] + std::remainder(mean - printer.theta[k], 360 * kDegree);
  }
  const Readings heights = heights_only(printer.readings);
  if (!delta.rotary && !heights.empty())
    known.mean = fit(delta, known.mean, heights, adjusted(delta, false).leftCols(4));
  return known;
}

/// The nominal values that a file with the estimate must keep for prior(): otherwise the estimate
/// would become the next nominal, and the same readings would count twice.
inline vector<pair<Place, double>> nominal_to_keep(const Prior& known, const Printer& printer) {
  const Delta& delta = printer.delta;
  vector<pair<Place, double>> kept;
  for (int k = 0; k < delta.count(); ++k) {
    const Option& of = printer.options[k];
    const bool rod = k >= delta.rod() && k < delta.endstop();
    if (rod ? k == delta.rod() : delta.rotary && !of.angle())
      kept.push_back({{of.place.first, (rod ? "" : kNominal) + of.place.second},
                      std::nearbyint(known.mean[k] / of.scale() * 1e6) * 1e-6});
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
