// Kinematics of linear and rotary delta printers by Klipper's parameters p, with slopes.
//
// Tower i's rod, of length L, is from the nozzle x to the joint C_i(q): for a linear delta
// (R cos α, R sin α, q), for a rotary one ((R + u cos q) cos α, (R + u cos q) sin α, H + u sin q),
// with R, α, u, H its radius, angle, upper arm and shoulder height. So x is where three spheres
// meet. A motor that moved s steps down from its endstop has q = q_E - s d, d its step distance,
// q_E that of the nozzle at (0, 0, E_i): Klipper's position_endstop is the nozzle's height at the
// centre with motor i at its endstop (klippy/kinematics/delta.py, rotary_delta.py). m, rad.
#pragma once

#include <Eigen/Dense>

#include "truepose/printers/text.hpp"

namespace truepose::printers {
using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;
using Vector3 = Eigen::Vector3d;

/// A kind of delta. p has the radius, a rotary delta's shoulder height, then by tower: angles, a
/// rotary delta's upper arms, the rods ("arms", "lower arms"), endstops.
struct Delta {
  bool rotary = false;
  Vector3 step = Vector3::Ones();  ///< motion of carriage or arm per step, m or rad

  int angle() const { return rotary ? 2 : 1; }
  int upper() const { return 5; }
  int rod() const { return rotary ? 8 : 4; }
  int endstop() const { return rod() + 3; }
  int count() const { return rod() + 6; }

  /// q of motor i with the nozzle at x; NaN if its rod does not reach.
  double motor(const Vector& p, int i, const Vector3& x) const {
    const double c = std::cos(p[angle() + i]), s = std::sin(p[angle() + i]), L = p[rod() + i];
    const double out = x[0] * c + x[1] * s - p[0], aside = x[1] * c - x[0] * s;
    const double rod2 = L * L - aside * aside;
    if (!rotary) return x[2] + std::sqrt(rod2 - out * out);
    const double up = x[2] - p[1], u = p[upper() + i], reach2 = out * out + up * up;
    return std::atan2(up, out) + std::acos((reach2 + u * u - rod2) / (2 * u * std::sqrt(reach2)));
  }

  /// C_i(q), and its slopes by p and q where asked for.
  Vector3 joint(const Vector& p, int i, double q, Matrix* by_p = nullptr,
                Vector3* by_q = nullptr) const {
    const double c = std::cos(p[angle() + i]), s = std::sin(p[angle() + i]);
    const double u = rotary ? p[upper() + i] : 0, cq = std::cos(q), sq = std::sin(q);
    const double r = p[0] + u * cq;
    if (by_p) {
      by_p->setZero(3, count());
      by_p->col(0) << c, s, 0;
      by_p->col(angle() + i) << -r * s, r * c, 0;
      if (rotary) {
        by_p->col(1) << 0, 0, 1;
        by_p->col(upper() + i) << cq * c, cq * s, sq;
      }
    }
    if (by_q && rotary) *by_q << -u * sq * c, -u * sq * s, u * cq;
    if (by_q && !rotary) *by_q << 0, 0, 1;
    return {r * c, r * s, rotary ? p[1] + u * sq : q};
  }

  double homed(const Vector& p, int i) const { return motor(p, i, {0, 0, p[endstop() + i]}); }

  /// Steps down from the endstops with the nozzle at x; NaN if it cannot be there.
  Vector3 steps(const Vector& p, const Vector3& x) const {
    Vector3 result;
    for (int i = 0; i < 3; ++i) result[i] = (homed(p, i) - motor(p, i, x)) / step[i];
    return result;
  }

  /// The nozzle at these steps, below the joints; NaN if it cannot be there. The slopes by p, 3 by
  /// count(), at fixed steps where asked for.
  Vector3 position(const Vector& p, const Vector3& steps, Matrix* slopes = nullptr) const {
    Vector3 q, C[3];
    for (int i = 0; i < 3; ++i) {
      q[i] = homed(p, i) - steps[i] * step[i];
      C[i] = joint(p, i, q[i]);
    }
    const Vector3 to2 = C[1] - C[0], to3 = C[2] - C[0];
    const double d = to2.norm();
    const Vector3 ex = to2 / d, aside = to3 - ex.dot(to3) * ex, ey = aside.normalized();
    const double i3 = ex.dot(to3), j3 = aside.norm(), L = p[rod()];
    const double L2 = p[rod() + 1], L3 = p[rod() + 2];
    const double a = (L * L - L2 * L2 + d * d) / (2 * d);
    const double b = (L * L - L3 * L3 - a * a + (a - i3) * (a - i3) + j3 * j3) / (2 * j3);
    const Vector3 ez = ex.cross(ey);
    const double up = std::sqrt(L * L - a * a - b * b);  // NaN: the spheres do not meet
    const Vector3 x = C[0] + a * ex + b * ey + (ez[2] > 0 ? -up : up) * ez;
    if (slopes) *slopes = slopes_at(p, x, q);
    return x;
  }

  /// Slopes of homed() of every motor by p.
  Matrix homed_slopes(const Vector& p) const {
    Matrix home(3, count()), by_p;
    Vector3 by_q;
    for (int i = 0; i < 3; ++i) {
      const Vector3 end(0, 0, p[endstop() + i]);
      const Vector3 g = end - joint(p, i, homed(p, i), &by_p, &by_q);
      home.row(i) = -g.transpose() * by_p;
      home(i, rod() + i) -= p[rod() + i];
      home(i, endstop() + i) += g[2];
      home.row(i) /= g.dot(by_q);
    }
    return home;
  }
  /// Slopes of the nozzle x, whose motors are at q, by p at fixed steps: those of |x - C_i|² =
  /// L_i².
  Matrix slopes_at(const Vector& p, const Vector3& x, const Vector3& q) const {
    const Matrix home = homed_slopes(p);
    Eigen::Matrix3d A;
    Matrix B(3, count()), by_p;
    Vector3 by_q;
    for (int i = 0; i < 3; ++i) {
      const Vector3 g = x - joint(p, i, q[i], &by_p, &by_q);
      A.row(i) = g.transpose();
      B.row(i) = g.transpose() * by_p + g.dot(by_q) * home.row(i);
      B(i, rod() + i) += p[rod() + i];
    }
    return A.inverse() * B;
  }
  /// As slopes_at(), for a nozzle wherever its motors can bring it.
  Matrix slopes(const Vector& p, const Vector3& x) const {
    return slopes_at(p, x, {motor(p, 0, x), motor(p, 1, x), motor(p, 2, x)});
  }
};
}  // namespace truepose::printers
