// Errors of the nozzle over the bed, and the most useful next readings.
//
// For position x, a printer with parameters p_c moves its motors to q = IKM(x; p_c). With the
// estimate p̂ of covariance P its nozzle is at FKM(q; p̂), with covariance E P Eᵀ, E = ∂x/∂p. Common
// shift and rotation of the print do not count as errors of x and y, since its place on the bed is
// arbitrary. Errors of z count fully. m, rad.
#pragma once

#include "truepose/printers/judge.hpp"

namespace truepose::printers {
/// Evenly spread points of a disc at z = 0, on rings.
inline vector<Vector3> disc(int rings, double radius) {
  vector<Vector3> points{Vector3::Zero()};
  for (int ring = 1; ring <= rings; ++ring)
    for (int k = 0; k < 6 * ring; ++k) {
      const double turn = 60 * kDegree * k / ring, r = radius * ring / rings;
      points.emplace_back(r * cos(turn), r * sin(turn), 0);
    }
  return points;
}
constexpr int kRings = 12;  ///< of points over the bed

/// Predicted errors over the bed for the parameters in use; NaN out of their reach.
struct Bed {
  vector<Vector3> points, offset, sigma;  ///< nozzle by the estimate − desired position; its σ

  Vector3 error(size_t k) const {
    return (offset[k].array().square() + sigma[k].array().square()).sqrt();
  }
  Vector3 rms() const {
    Vector3 sum = Vector3::Zero();
    double count = 0;
    for (size_t k = 0; k < points.size(); ++k)
      if (error(k).allFinite()) sum += error(k).cwiseAbs2(), ++count;
    return (sum / count).cwiseSqrt();
  }
};

/// Predict the errors of a printer that uses the parameters `used`: its file's, or the estimate's.
inline Bed over_the_bed(const Delta& delta, const Vector& used, const Estimate& found,
                        double radius) {
  Bed bed{disc(kRings, radius), {}, {}};
  const int P = delta.count(), size = 3 * int(bed.points.size());
  Matrix E = Matrix::Zero(size, P + 1), rigid = Matrix::Zero(size, 3);  // ∂x/∂p, then the offset
  vector<int> reached;
  for (int row = 0; row < size; row += 3) {
    const Vector3& x = bed.points[row / 3];
    Matrix slopes;
    const Vector3 there = delta.position(found.theta, delta.steps(used, x), &slopes);
    if (!there.allFinite() || !slopes.allFinite()) continue;
    E.middleRows<3>(row) << slopes, there - x;
    rigid.middleRows<3>(row) << 1, 0, -x[1], 0, 1, x[0], 0, 0, 0;  // shifts and rotation
    reached.push_back(row);
  }
  bed.offset = bed.sigma = vector<Vector3>(bed.points.size(), Vector3::Constant(kNaN));
  if (reached.size() < 2 * kRings) return bed;
  E -= rigid * (rigid.transpose() * rigid).inverse() * (rigid.transpose() * E);
  for (const int row : reached) {
    const Matrix J = E.block(row, 0, 3, P);
    bed.offset[row / 3] = E.block<3, 1>(row, P);
    bed.sigma[row / 3] = (J * found.covariance.topLeftCorner(P, P) * J.transpose())
                             .diagonal()
                             .cwiseMax(0)
                             .cwiseSqrt();
  }
  return bed;
}

/// A reading to take, and the σ of the nozzle over the bed with all up to it.
struct Planned {
  bool distance = false;
  Vector3 at[2] = {Vector3::Zero(), Vector3::Zero()};
  Vector3 sigma = Vector3::Zero();  ///< of x, y, z, m
};
/// The readings that minimise the variance of the nozzle over the bed together: heights over the
/// bed, and distances between possible pillars. The first element is the σ before any.
/// `heights_first`: so many heights come before any distance. Empty: the nozzle cannot be over the
/// bed.
inline vector<Planned> next_readings(const Printer& printer, const Estimate& found,
                                     const Assumed& noise, int count, int heights_first) {
  constexpr double kShortest = 20 * kMm;
  constexpr int kExchanges = 20;
  const auto at = [&](const Vector3& x) { return slopes(printer.delta, found, x); };
  Matrix M[3];
  for (Matrix& each : M) each.setZero(found.P.rows(), found.P.rows());
  double points = 0;
  for (const Vector3& x : disc(kRings, printer.radius))
    if (const Matrix E = at(x); E.allFinite()) {
      for (int i = 0; i < 3; ++i) M[i] += E.row(i).transpose() * E.row(i);
      ++points;
    }
  if (points == 0) return {};
  struct Candidate {
    Planned reading;
    Vector g;
    double variance = 0;
  };
  vector<Candidate> candidates;
  const auto add = [&](bool distance, const Vector3& a, const Vector3& b, const Vector& g) {
    candidates.push_back({{distance, {a, b}, Vector3::Zero()}, g, pow(noise.noise(distance), 2)});
  };
  for (const Vector3& x : disc(4, printer.radius)) add(false, x, x, at(x).row(2));
  const vector<Vector3> pillars = disc(2, 0.9 * printer.radius);
  for (const Vector3& a : pillars)
    for (const Vector3& b : pillars)
      if (const Vector3 apart = a - b; &a < &b && apart.norm() > kShortest)
        add(true, a, b,
            (at(a) - at(b)).transpose() * (1 - found.theta[printer.delta.count()]) *
                    apart.normalized() +
                found.S.transpose().rightCols<2>() * Eigen::Vector2d(-apart.norm(), 1));
  using Pool = vector<const Candidate*>;
  const auto covariance = [&](const Pool& taken) {
    Matrix P = found.P;
    for (const Candidate* each : taken) {
      const Vector step = P * each->g;
      P -= step * step.transpose() / (each->variance + each->g.dot(step));
    }
    return P;
  };
  const auto best = [&](const Pool& taken, const Pool& among, size_t number) {
    const Matrix P = covariance(taken), all = P * (M[0] + M[1] + M[2]) * P;
    const Candidate* at = nullptr;
    double most = 0;
    for (const Candidate* each : among) {
      if (each->reading.distance && int(number) < heights_first) continue;
      const double gain = each->g.dot(all * each->g) / (each->variance + each->g.dot(P * each->g));
      if (!(gain > most * (1 + 1e-9))) continue;  // NaN: out of reach
      most = gain;
      at = each;
    }
    return at;
  };
  const auto one_by_one = [&](Pool among) {
    Pool taken;
    while (int(taken.size()) < count) {
      const Candidate* next = best(taken, among, taken.size());
      if (!next) break;
      taken.push_back(next);
      std::erase(among, next);
    }
    return taken;
  };
  Pool left;
  for (const Candidate& each : candidates) left.push_back(&each);
  Pool chosen = one_by_one(left);
  for (const Candidate* each : chosen) std::erase(left, each);
  // Exchange one for a better one until none is; then the most useful first.
  bool changed = !left.empty();
  for (int round = 0; round < kExchanges && changed; ++round) {
    changed = false;
    for (size_t k = 0; k < chosen.size(); ++k) {
      Pool others = chosen;
      others.erase(others.begin() + std::ptrdiff_t(k));
      left.insert(left.begin(), chosen[k]);  // itself unless another is better
      chosen[k] = best(others, left, k);
      changed = changed || chosen[k] != left.front();
      std::erase(left, chosen[k]);
    }
  }
  chosen = one_by_one(chosen);
  vector<Planned> plan;
  for (size_t k = 0; k <= chosen.size(); ++k) {
    const Matrix P = covariance(Pool(chosen.begin(), chosen.begin() + std::ptrdiff_t(k)));
    Planned& each = plan.emplace_back(k ? chosen[k - 1]->reading : Planned());
    for (int i = 0; i < 3; ++i) each.sigma[i] = sqrt(P.cwiseProduct(M[i]).sum() / points);
  }
  return plan;
}
}  // namespace truepose::printers
