// The forward kinematic model in closed form where the orientation is known: D is on n spheres.
#include "mechanism/fkm_closed.hpp"

namespace truepose {
Outcome fkm_closed(const Robot& robot, const Joint& q, const Mat3& R, const Vec3& near_side,
                   Vec3& D) {
  if (!robot.finished) return {Status::unfinished};
  const int m = robot.motors;
  std::array<Vec3, kMaxMotors> t;
  Joint g;
  Vec3 mean = Vec3::Zero();
  for (int i : range(m)) {
    const Driven driven = driven_point(robot.chain[i], q[i]);
    t[i] = robot.chain[i].base + driven.p - R * robot.chain[i].pivot - robot.chain[i].anchor;
    g[i] = driven.rod * driven.rod;
    mean += t[i];
  }
  mean *= 1.0 / m;
  Real square = 0;  // |y|²
  for (int i : range(m)) {
    t[i] -= mean;
    g[i] = t[i].squaredNorm() - g[i];
    square -= g[i];
  }
  square *= 1.0 / m;
  Mat3 T = Mat3::Zero();
  Vec3 h = Vec3::Zero();
  for (int i : range(m)) {
    T += outer(t[i], t[i]);
    h += (0.5 * (g[i] + square)) * t[i];
  }

  // The columns of T's adjugate are the cross products of T's columns. For rank 2 each is a
  // multiple of the weakest direction; for rank 3 the longest is near it, which suffices.
  const auto shorter = [](const Vec3& a, const Vec3& b) {
    return a.squaredNorm() < b.squaredNorm();
  };
  const Vec3 longest =
      max({T.col(1).cross(T.col(2)), T.col(2).cross(T.col(0)), T.col(0).cross(T.col(1))}, shorter);
  const Real length = longest.norm(), size = T.trace();
  if (!isfinite(length)) return {Status::not_finite};
  if (!(length > by_precision(1e-10, 1e-5) * size * size)) return {Status::singular};
  const Vec3 weakest = longest / length;

  // y = particular + λ direction: e_k·T y = e_k·h across the weakest direction, λ along it.
  const Vec3 e1 = normal_to(weakest), e2 = weakest.cross(e1);
  const Vec3 T1 = T * e1, T2 = T * e2, line = T1.cross(T2);
  const Real per_det = 1 / weakest.dot(line);
  const Vec3 direction = per_det * line;
  const Vec3 particular = per_det * (e1.dot(h) * T2.cross(weakest) + e2.dot(h) * weakest.cross(T1));
  const Real A = direction.squaredNorm(), B = particular.dot(direction);
  const Real root2 = B * B - A * (particular.squaredNorm() - square);
  if (!(root2 >= 0)) return {Status::unreachable};
  const Real side = weakest.dot(near_side - mean) < 0 ? -1 : 1;
  D = mean + particular + direction * ((side * sqrt(root2) - B) / A);
  return {};
}
}  // namespace truepose
