// Loop-closure residuals with the motors held, and their derivatives by the platform's motion.
#pragma once

#include "truepose/kinematics/jacobian.hpp"

namespace truepose {
/// f_i = (|v_i|² - L_i²)/2, zero where chain i closes; derivative -J_x in the pose's tangent space.
template <Mobility K>
class RodLoops {
 public:
  static constexpr int n = kDof<K>;
  using Columns = std::array<Lanes<n>, n>;

  /// The loops at a pose.
  struct At {
    Pose pose;
    Points<n> lever, v;
    Lanes<n> f;
    Real cost, residual;  ///< Σf², largest closure error (m)
  };

  RodLoops(const Robot& robot, const std::array<Driven, n>& driven)
      : pivot_(points<n>([&](int i) -> Vec3 { return robot.chain[i].pivot(); })),
        centre_(points<n>([&](int i) -> Vec3 {  // of the sphere of points D + R c
          return robot.chain[i].base() + driven[i].p - robot.chain[i].anchor();
        })) {
    const auto rod = lanes<n>([&](int i) { return driven[i].rod; });
    half_rod2_ = 0.5 * rod * rod;
    per_rod_ = 1 / rod;
  }

  void start(const Pose& pose, At& at) const {
    at.pose = pose;
    evaluate(at);
  }
  void after(const At& from, const Coordinates& motion, At& at) const {
    at.pose = moved<K>(from.pose, motion);
    evaluate(at);
  }

  void jx(const At& at, Columns& columns) const { jx_row<K>({}, at.v, at.lever, columns); }
  std::array<Real, n> sizes(const At& at) const {
    return column_sizes<K>({}, at.v.squared_norm(), at.lever);
  }
  /// A to B of every chain.
  const Points<n>& rods(const At& at) const { return at.v; }

 private:
  void evaluate(At& at) const {
    at.lever = turned<K>(at.pose.R, pivot_);
    const Vec3& D = at.pose.D;
    at.v = {centre_.px - D.x() - at.lever.px, centre_.py - D.y() - at.lever.py,
            centre_.pz - D.z() - at.lever.pz};
    at.f = 0.5 * at.v.squared_norm() - half_rod2_;
    at.cost = (at.f * at.f).sum();
    at.residual = largest<n>(at.f.abs() * per_rod_);  // |v| - L = f / L to first order
  }

  Points<n> pivot_, centre_;
  Lanes<n> half_rod2_, per_rod_;
};

/// Loops of a rotational platform. f_i is linear in (1, cos x_j, sin x_j) of each axis: with
/// S = B - o_1, y_j = R_j (o_{j+1} + y_{j+1}) and y_n = R_n c,
///
///     f = (|S|² + Σ|o_j|² + |c|² - L²)/2 - S·y_1 + Σ o_j·y_j         (j > 1 in both sums)
///
/// and p·R y = p·d d·y + cos x (p - p·d d)·y + sin x (p × d)·y for any p. The 3ⁿ coefficients are
/// summed once per search; a step then costs a tenth of evaluating the chain of frames.
template <Mobility K>
class RotationalLoops {
 public:
  static constexpr int n = kDof<K>;
  using Columns = std::array<Lanes<n>, n>;

  /// The loops at a pose.
  struct At {
    Pose pose;
    std::array<Real, n> cosine, sine;  ///< of the axes' angles
    Columns columns;                   ///< of J_x
    Lanes<n> f;
    Real cost, residual;
  };

  RotationalLoops(const Robot& robot, const std::array<Driven, n>& driven)
      : robot_(robot),
        B_(points<n>([&](int i) -> Vec3 { return robot.chain[i].base() + driven[i].p; })) {
    const auto c = points<n>([&](int i) -> Vec3 { return robot.chain[i].pivot(); });
    const auto rod = lanes<n>([&](int i) { return driven[i].rod; });
    per_rod_ = 1 / rod;
    const Vec3 first = robot.axis[0].origin();
    const Points<n> S{B_.px - first.x(), B_.py - first.y(), B_.pz - first.z()};
    Lanes<n> part2 = c.squared_norm();  // plus the offsets up to axis j
    const Lanes<n> rod2 = rod * rod;
    coefficient_.fill(Lanes<n>::Zero());
    for (int j = n - 1; j >= 0; --j) {
      size_[j] = (n - j) * (part2 * rod2).sum();  // upper bound of |A - p_j|²
      if (j > 0) part2 += robot.axis[j].origin().squaredNorm();
    }
    coefficient_[0] = 0.5 * (S.squared_norm() + part2 - rod2);
    add<0>({-S.px, -S.py, -S.pz}, c, coefficient_.data());
    if constexpr (n > 1) add<1>(all(robot.axis[1].origin()), c, coefficient_.data());
    if constexpr (n > 2) add<2>(all(robot.axis[2].origin()), c, coefficient_.data());
  }

  void start(const Pose& pose, At& at) const {
    at.pose = pose;
    for (int j = 0; j < n; ++j) turn_to(pose.D[j], at.cosine[j], at.sine[j]);
    evaluate(at);
  }
  void after(const At& from, const Coordinates& motion, At& at) const {
    at.pose = moved<K>(from.pose, motion);
    for (int j = 0; j < n; ++j) {
      at.cosine[j] = from.cosine[j];
      at.sine[j] = from.sine[j];
      turn_by(motion[j], at.pose.D[j], at.cosine[j], at.sine[j]);
    }
    evaluate(at);
  }

  void jx(const At& at, Columns& columns) const { columns = at.columns; }
  const std::array<Real, n>& sizes(const At&) const { return size_; }
  Points<n> rods(const At& at) const {
    const Pose placed = carried_frames<K>(robot_, at.cosine, at.sine).pose;
    const auto A =
        turned<K>(placed.R, points<n>([&](int i) -> Vec3 { return robot_.chain[i].pivot(); }));
    return {B_.px - placed.D.x() - A.px, B_.py - placed.D.y() - A.py, B_.pz - placed.D.z() - A.pz};
  }

 private:
  static constexpr int kTerms = n == 1 ? 3 : n == 2 ? 9 : 27;

  // As lanes: clang multiplies Eigen lanes by a scalar through memory, which stalls.
  static Points<n> all(const Vec3& p) {
    return {Lanes<n>::Constant(p.x()), Lanes<n>::Constant(p.y()), Lanes<n>::Constant(p.z())};
  }
  static Lanes<n> dot(const Points<n>& a, const Points<n>& b) {
    return a.px * b.px + a.py * b.py + a.pz * b.pz;
  }

  /// Adds p·y_j, j counted from 0, to the coefficients of the axes from j on.
  template <int J>
  void add(const Points<n>& p, const Points<n>& c, Lanes<n>* k) const {
    const Points<n> d = all(robot_.axis[J].direction());
    const Lanes<n> along = dot(p, d);
    const Points<n> fixed{along * d.px, along * d.py, along * d.pz};
    const Points<n> parts[]{
        fixed,
        {p.px - fixed.px, p.py - fixed.py, p.pz - fixed.pz},
        {p.py * d.pz - p.pz * d.py, p.pz * d.px - p.px * d.pz, p.px * d.py - p.py * d.px}};
    constexpr int stride = J + 1 == n ? 1 : J + 2 == n ? 3 : 9;
    for (int part = 0; part < 3; ++part) {
      if constexpr (J + 1 == n) {
        k[part] += dot(parts[part], c);
      } else {
        k[part * stride] += dot(parts[part], all(robot_.axis[J + 1].origin()));
        add<J + 1>(parts[part], c, k + part * stride);
      }
    }
  }

  /// Contracts the axes from J down in the coefficients `from`, into the value and its slopes.
  template <int J>
  static void contract(const At& at, const Lanes<n>* from, Lanes<n>* value,
                       std::array<std::array<Lanes<n>, kTerms / 3>, n>& slope) {
    constexpr int left = J == 0 ? 1 : J == 1 ? 3 : 9;
    const Lanes<n> c = Lanes<n>::Constant(at.cosine[J]), s = Lanes<n>::Constant(at.sine[J]);
    for (int a = 0; a < left; ++a) {
      for (int i = J + 1; i < n; ++i)
        slope[i][a] = slope[i][3 * a] + c * slope[i][3 * a + 1] + s * slope[i][3 * a + 2];
      slope[J][a] = s * from[3 * a + 1] - c * from[3 * a + 2];
      value[a] = from[3 * a] + c * from[3 * a + 1] + s * from[3 * a + 2];
    }
    if constexpr (J > 0) contract<J - 1>(at, value, value, slope);
  }

  void evaluate(At& at) const {
    std::array<Lanes<n>, kTerms / 3> value;
    std::array<std::array<Lanes<n>, kTerms / 3>, n> slope;  // -∂/∂x_j
    contract<n - 1>(at, coefficient_.data(), value.data(), slope);
    at.f = value[0];
    for (int j = 0; j < n; ++j) at.columns[j] = slope[j][0];
    at.cost = (at.f * at.f).sum();
    at.residual = largest<n>(at.f.abs() * per_rod_);
  }

  const Robot& robot_;
  Points<n> B_;
  Lanes<n> per_rod_;
  std::array<Lanes<n>, kTerms> coefficient_;
  std::array<Real, n> size_;
};

/// The loops of a mobility.
template <Mobility K>
using Loops = std::conditional_t<kRotational<K>, RotationalLoops<K>, RodLoops<K>>;
}  // namespace truepose
