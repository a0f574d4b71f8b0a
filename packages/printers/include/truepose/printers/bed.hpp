// Errors of the nozzle over the bed, and the most useful next readings.
//
// For position x, a printer with parameters p_c moves its motors to q = IKM(x; p_c). With the
// estimate p̂ of covariance P its nozzle is at FKM(q; p̂), with covariance E P Eᵀ, E = ∂x/∂p. Common
// shift and rotation of the print do not count as errors of x and y, since its place on the bed is
// arbitrary. Errors of z count fully. m, rad.
#pragma once

#include "truepose/printers/judge.hpp"

namespace truepose::printers {
/// Predicted errors over the bed for the parameters in use; no points if they cannot reach it.
struct Bed {
  vector<Vector3> points, offset, sigma;  ///< nozzle by the estimate − desired position; its σ

  Vector3 error(size_t k) const {
    return (offset[k].array().square() + sigma[k].array().square()).sqrt();
  }
  Vector3 rms() const {
    Vector3 sum = Vector3::Zero();
    for (size_t k = 0; k < points.size(); ++k) sum += error(k).cwiseAbs2();
    return points.empty() ? Vector3::Constant(kNaN)
                          : Vector3((sum / double(points.size())).cwiseSqrt());
  }
};

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

/// Predict the errors of a printer that uses the parameters `used`: its file's, or the estimate's.
inline Bed over_the_bed(const Delta& delta, const Vector& used, const Estimate& found,
                        double radius) {
  Bed bed;
  vector<Matrix> E;
  for (const Vector3& x : disc(kRings, radius)) {
    Matrix slopes;
    const Vector3 there = delta.position(found.theta, delta.steps(used, x), &slopes);
    if (!there.allFinite() || !slopes.allFinite()) continue;
    bed.points.push_back(x);
    bed.offset.push_back(there - x);
    E.push_back(std::move(slopes));
  }
  const size_t count = bed.points.size();
  if (count < 2 * kRings) return {};
  const int N = int(count);
  Matrix rigid(2 * N, 3), planar(2 * N, delta.count());  // shifts and rotation of x and y
  Vector off(2 * N);
  for (int k = 0; k < N; ++k) {
    const size_t at = size_t(k);
    rigid.row(2 * k) << 1, 0, -bed.points[at][1];
    rigid.row(2 * k + 1) << 0, 1, bed.points[at][0];
    planar.middleRows(2 * k, 2) = E[at].topRows(2);
    off.segment<2>(2 * k) = bed.offset[at].head<2>();
  }
  const Matrix remove = (rigid.transpose() * rigid).inverse() * rigid.transpose();
  planar -= rigid * (remove * planar);
  off -= rigid * (remove * off);
  const Matrix covariance = found.covariance.topLeftCorner(delta.count(), delta.count());
  for (int k = 0; k < N; ++k) {
    const size_t at = size_t(k);
    E[at].topRows(2) = planar.middleRows(2 * k, 2);
    bed.offset[at].head<2>() = off.segment<2>(2 * k);
    bed.sigma.push_back(
        (E[at] * covariance * E[at].transpose()).diagonal().cwiseMax(0).cwiseSqrt());
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
  const Delta& delta = printer.delta;
  const auto at = [&](const Vector3& x) { return slopes(delta, found, x); };
  vector<Planned> plan;
  Matrix M[3];
  for (Matrix& each : M) each.setZero(found.P.rows(), found.P.rows());
  double points = 0;
  for (const Vector3& x : disc(kRings, printer.radius))
    if (const Matrix E = at(x); E.allFinite()) {
      for (int i = 0; i < 3; ++i) M[i] += E.row(i).transpose() * E.row(i);
      points += 1;
    }
  if (points == 0) return plan;
  struct Candidate {
    Planned reading;
    Vector g;
    double variance = 0;
  };
  vector<Candidate> candidates;
  for (const Vector3& x : disc(4, printer.radius))
    candidates.push_back(
        {{false, {x, x}, Vector3::Zero()}, at(x).row(2), pow(noise.noise(false), 2)});
  const vector<Vector3> pillars = disc(2, 0.9 * printer.radius);
  for (size_t a = 0; a < pillars.size(); ++a)
    for (size_t b = a + 1; b < pillars.size(); ++b) {
      const Vector3 apart = pillars[a] - pillars[b];
      if (apart.norm() <= kShortest) continue;
      const Vector3 along = (1 - found.theta[delta.count()]) * apart.normalized();
      const Vector g = (at(pillars[a]) - at(pillars[b])).transpose() * along +
                       found.S.transpose().rightCols<2>() * Eigen::Vector2d(-apart.norm(), 1);
      candidates.push_back(
          {{true, {pillars[a], pillars[b]}, Vector3::Zero()}, g, pow(noise.noise(true), 2)});
    }
  const auto taken = [&](Matrix& by, int k) {  // covariance with one reading more
    const Candidate& each = candidates[k];
    const Vector step = by * each.g;
    by -= step * step.transpose() / (each.variance + each.g.dot(step));
  };
  const auto best = [&](const Matrix& by, const vector<int>& among, bool height) {
    const Matrix all = by * (M[0] + M[1] + M[2]) * by;
    int at = -1;
    double most = 0;
    for (const int k : among) {
      const Candidate& each = candidates[k];
      const double gain = each.g.dot(all * each.g) / (each.variance + each.g.dot(by * each.g));
      if (gain > most * (1 + 1e-9) && !(height && each.reading.distance)) {  // NaN: out of reach
        most = gain;
        at = k;
      }
    }
    return at;
  };
  vector<int> left, chosen;
  for (size_t k = 0; k < candidates.size(); ++k) left.push_back(k);
  Matrix P = found.P;
  while (int(chosen.size()) < count) {
    const int next = best(P, left, int(chosen.size()) < heights_first);
    if (next < 0) break;
    taken(P, next);
    chosen.push_back(next);
    std::erase(left, next);
  }
  // Exchange one for a better one until none is; then the most useful first.
  bool changed = chosen.size() < left.size();
  for (int round = 0; round < kExchanges && changed; ++round) {
    changed = false;
    for (size_t k = 0; k < chosen.size(); ++k) {
      P = found.P;
      for (size_t j = 0; j < chosen.size(); ++j)
        if (j != k) taken(P, chosen[j]);
      left.insert(left.begin(), chosen[k]);  // itself unless another is better
      chosen[k] = best(P, left, int(k) < heights_first);
      changed = changed || chosen[k] != left.front();
      std::erase(left, chosen[k]);
    }
  }
  Planned reading;
  P = found.P;
  for (int k = 0;; ++k) {
    for (int i = 0; i < 3; ++i) reading.sigma[i] = sqrt(P.cwiseProduct(M[i]).sum() / points);
    plan.push_back(reading);
    const int next = best(P, chosen, k < heights_first);
    if (next < 0) return plan;
    taken(P, next);
    reading = candidates[next].reading;
    std::erase(chosen, next);
  }
}
}  // namespace truepose::printers
