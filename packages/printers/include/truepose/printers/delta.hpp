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
    const double c = cos(p[angle() + i]), s = sin(p[angle() + i]), L = p[rod() + i];
    const double out = x[0] * c + x[1] * s - p[0], aside = x[1] * c - x[0] * s;
    const double rod2 = L * L - aside * aside;
    if (!rotary) return x[2] + sqrt(rod2 - out * out);
    const double up = x[2] - p[1], u = p[upper() + i], reach2 = out * out + up * up;
    return std::atan2(up, out) + std::acos((reach2 + u * u - rod2) / (2 * u * sqrt(reach2)));
  }

  /// C_i(q).
  Vector3 joint(const Vector& p, int i, double q) const {
    const double a = p[angle() + i], u = rotary ? p[upper() + i] : 0, r = p[0] + u * cos(q);
    return {r * cos(a), r * sin(a), rotary ? p[1] + u * sin(q) : q};
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
    const double up = sqrt(L * L - a * a - b * b);  // NaN: the spheres do not meet
    const Vector3 x = C[0] + a * ex + b * ey + (ez[2] > 0 ? -up : up) * ez;
    if (slopes) *slopes = slopes_at(p, x, q);
    return x;
  }

  /// Slopes of the nozzle x, whose motors are at q, by p at fixed steps. Each tower's sphere,
  /// (L² - |g|²) / 2 with g = x - C(q), stays 0, at x and with (0, 0, E) where its motor is at its
  /// endstop; its slopes by x are -g.
  Matrix slopes_at(const Vector& p, const Vector3& x, const Vector3& q) const {
    Eigen::Matrix3d A;
    Matrix B(3, count());
    for (int i = 0; i < 3; ++i) {
      const double c = cos(p[angle() + i]), s = sin(p[angle() + i]);
      const double u = rotary ? p[upper() + i] : 0;
      Eigen::RowVectorXd home;
      for (const bool homing : {true, false}) {
        const double at = homing ? homed(p, i) : q[i], cq = cos(at), sq = sin(at);
        const Vector3 g = (homing ? Vector3(0, 0, p[endstop() + i]) : x) - joint(p, i, at);
        const double out = c * g[0] + s * g[1];
        const double by_q = rotary ? u * (cq * g[2] - sq * out) : g[2];
        Eigen::RowVectorXd by_p = Eigen::RowVectorXd::Zero(count());
        by_p[0] = out;
        by_p[angle() + i] = (p[0] + u * cq) * (c * g[1] - s * g[0]);
        by_p[rod() + i] = p[rod() + i];
        if (rotary) by_p[1] = g[2], by_p[upper() + i] = cq * out + sq * g[2];
        if (homing) by_p[endstop() + i] = -g[2], home = -by_p / by_q;
        B.row(i) = by_p + by_q * home;
        A.row(i) = g;
      }
    }
    return A.inverse() * B;
  }
  /// As slopes_at(), for a nozzle wherever its motors can bring it.
  Matrix slopes(const Vector& p, const Vector3& x) const {
    return slopes_at(p, x, {motor(p, 0, x), motor(p, 1, x), motor(p, 2, x)});
  }
};
}  // namespace truepose::printers
