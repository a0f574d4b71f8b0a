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
  std::vector<Vector3> points, offset, sigma;  ///< nozzle by the estimate − desired position; its σ

  Vector3 error(std::size_t k) const {
    return (offset[k].array().square() + sigma[k].array().square()).sqrt();
  }
  Vector3 rms() const {
    Vector3 sum = Vector3::Zero();
    for (std::size_t k = 0; k < points.size(); ++k) sum += error(k).cwiseAbs2();
    return points.empty() ? Vector3::Constant(kNaN)
                          : Vector3((sum / double(points.size())).cwiseSqrt());
  }
};

/// Evenly spread points of a disc at z = 0, on rings.
inline std::vector<Vector3> disc(int rings, double radius) {
  std::vector<Vector3> points{Vector3::Zero()};
  for (int ring = 1; ring <= rings; ++ring)
    for (int k = 0; k < 6 * ring; ++k) {
      const double turn = 60 * kDegree * k / ring, r = radius * ring / rings;
      points.emplace_back(r * std::cos(turn), r * std::sin(turn), 0);
    }
  return points;
}
constexpr int kRings = 12;  ///< of points over the bed

/// Predict the errors of a printer that uses the parameters `used`: its file's, or the estimate's.
inline Bed over_the_bed(const Delta& delta, const Vector& used, const Estimate& found,
                        double radius) {
  Bed bed;
  const Vector p = found.p();
  std::vector<Matrix> E;
  for (const Vector3& x : disc(kRings, radius)) {
    Matrix slopes;
    const Vector3 there = delta.position(p, delta.steps(used, x), &slopes);
    if (!there.allFinite() || !slopes.allFinite()) continue;
    bed.points.push_back(x);
    bed.offset.push_back(there - x);
    E.push_back(std::move(slopes));
  }
  const std::size_t count = bed.points.size();
  if (count < 2 * kRings) return {};
  const auto N = Eigen::Index(count);
  Matrix rigid(2 * N, 3), planar(2 * N, p.size());  // shifts and rotation of x and y
  Vector off(2 * N);
  for (Eigen::Index k = 0; k < N; ++k) {
    const std::size_t at = std::size_t(k);
    rigid.row(2 * k) << 1, 0, -bed.points[at][1];
    rigid.row(2 * k + 1) << 0, 1, bed.points[at][0];
    planar.middleRows(2 * k, 2) = E[at].topRows(2);
    off.segment<2>(2 * k) = bed.offset[at].head<2>();
  }
  const Matrix remove = (rigid.transpose() * rigid).inverse() * rigid.transpose();
  planar -= rigid * (remove * planar);
  off -= rigid * (remove * off);
  const Matrix covariance = found.covariance.topLeftCorner(p.size(), p.size());
  for (Eigen::Index k = 0; k < N; ++k) {
    const std::size_t at = std::size_t(k);
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
inline std::vector<Planned> next_readings(const Printer& printer, const Prior& known,
                                          const Estimate& found, const Assumed& noise, int count,
                                          int heights_first) {
  constexpr double kShortest = 20 * kMm;
  constexpr int kExchanges = 20;
  const Delta& delta = printer.delta;
  const auto size = Eigen::Index(found.free.size());
  const auto slopes = [&](const Vector3& x) {  // of x by u; NaN where it cannot be
    const Matrix J = delta.slopes(found.p(), x);
    Matrix own = Matrix::Zero(3, size);
    for (Eigen::Index j = 0; j < size; ++j)
      if (const int at = found.free[std::size_t(j)]; at < delta.count())
        own.col(j) = known.sigma[at] * J.col(at);
    return own;
  };
  std::vector<Planned> plan;
  Matrix M[3];
  for (Matrix& each : M) each.setZero(size, size);
  double points = 0;
  for (const Vector3& x : disc(kRings, printer.radius))
    if (const Matrix E = slopes(x); E.allFinite()) {
      for (int i = 0; i < 3; ++i) M[i] += E.row(i).transpose() * E.row(i);
      points += 1;
    }
  if (points == 0) return plan;
  struct Candidate {
    Planned reading;
    Vector g;
    double variance = 0;
  };
  std::vector<Candidate> candidates;
  for (const Vector3& x : disc(4, printer.radius))
    candidates.push_back(
        {{false, {x, x}, Vector3::Zero()}, slopes(x).row(2), noise.height * noise.height});
  const std::vector<Vector3> pillars = disc(2, 0.9 * printer.radius);
  for (std::size_t a = 0; a < pillars.size(); ++a)
    for (std::size_t b = a + 1; b < pillars.size(); ++b) {
      const Vector3 apart = pillars[a] - pillars[b];
      if (apart.norm() <= kShortest) continue;
      const Vector3 along = (1 - found.shrinkage()) * apart.normalized();
      Vector g = (along.transpose() * (slopes(pillars[a]) - slopes(pillars[b]))).transpose();
      g[size - 2] -= known.sigma[delta.count()] * apart.norm();
      g[size - 1] += known.sigma[delta.count() + 1];
      candidates.push_back(
          {{true, {pillars[a], pillars[b]}, Vector3::Zero()}, g, noise.distance * noise.distance});
    }
  const auto taken = [](Matrix& by, const Candidate& each) {  // covariance with one reading more
    const Vector step = by * each.g;
    by -= step * step.transpose() / (each.variance + each.g.dot(step));
  };
  const auto best = [&](const Matrix& by, const std::vector<int>& among, bool height) {
    const Matrix all = by * (M[0] + M[1] + M[2]) * by;
    int at = -1;
    double most = 0;
    for (const int k : among) {
      const Candidate& each = candidates[std::size_t(k)];
      const double gain = each.g.dot(all * each.g) / (each.variance + each.g.dot(by * each.g));
      if (gain > most * (1 + 1e-9) && !(height && each.reading.distance)) {  // NaN: out of reach
        most = gain;
        at = k;
      }
    }
    return at;
  };
  std::vector<int> left(candidates.size()), chosen;
  for (std::size_t k = 0; k < left.size(); ++k) left[k] = int(k);
  Matrix P = found.P;
  while (int(chosen.size()) < count) {
    const int next = best(P, left, int(chosen.size()) < heights_first);
    if (next < 0) break;
    taken(P, candidates[std::size_t(next)]);
    chosen.push_back(next);
    std::erase(left, next);
  }
  // Exchange one for a better one until none is; then the most useful first.
  bool changed = chosen.size() < left.size();
  for (int round = 0; round < kExchanges && changed; ++round) {
    changed = false;
    for (std::size_t k = 0; k < chosen.size(); ++k) {
      P = found.P;
      for (std::size_t j = 0; j < chosen.size(); ++j)
        if (j != k) taken(P, candidates[std::size_t(chosen[j])]);
      left.push_back(chosen[k]);
      std::swap(left.front(), left.back());  // itself unless another is better
      chosen[k] = best(P, left, int(k) < heights_first);
      changed = changed || chosen[k] != left.front();
      std::erase(left, chosen[k]);
    }
  }
  Planned reading;
  P = found.P;
  for (int k = 0;; ++k) {
    for (int i = 0; i < 3; ++i) reading.sigma[i] = std::sqrt(P.cwiseProduct(M[i]).sum() / points);
    plan.push_back(reading);
    if (chosen.empty()) return plan;
    const int next = best(P, chosen, k < heights_first);
    if (next < 0) return plan;
    taken(P, candidates[std::size_t(next)]);
    reading = candidates[std::size_t(next)].reading;
    std::erase(chosen, next);
  }
}
}  // namespace truepose::printers
