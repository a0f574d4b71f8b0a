// Rotations and rotation vectors: exp, log and the angle θ about z.
#include "math/so3.hpp"

namespace truepose {
Versine versine_ratios(Real angle2) {
  if (!(angle2 < 1)) {
    const Real angle = sqrt(angle2);
    return {sin(angle) / angle, (1 - cos(angle)) / angle2};
  }
  Real sine = 1, versine = 1;
  for (int k = 8; k > 0; --k) {  // Horner's scheme
    sine = 1 - sine * (angle2 * kPerOdd[k]);
    versine = 1 - versine * (angle2 * kPerEven[k]);
  }
  return {sine, 0.5 * versine};
}

Mat3 rodrigues(Real c, const Vec3& s, const Vec3& u, const Vec3& w) {
  const Real xy = u.x() * w.y(), xz = u.x() * w.z(), yz = u.y() * w.z();
  return Mat3::of(c + u.x() * w.x(), xy - s.z(), xz + s.y(), xy + s.z(), c + u.y() * w.y(),
                  yz - s.x(), xz - s.y(), yz + s.x(), c + u.z() * w.z());
}

Mat3 exp_so3(const Vec3& w) {
  const Real angle2 = w.squaredNorm();
  const Versine ratios = versine_ratios(angle2);
  return rodrigues(1 - ratios.versine * angle2, ratios.sine * w, ratios.versine * w, w);
}

Vec3 log_so3(const Mat3& R) {
  Real c;  // cos(angle/2)
  Vec3 v;  // sin(angle/2) along the axis
  if (const Real trace = R.trace(); trace > 0) {
    const Real t = sqrt(trace + 1);
    c = 0.5 * t;
    v = 0.5 / t * Vec3(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  } else {
    int i = R(1, 1) > R(0, 0) ? 1 : 0;
    if (R(2, 2) > R(i, i)) i = 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const Real t = sqrt(R(i, i) - R(j, j) - R(k, k) + 1), per = 0.5 / t;
    v[i] = 0.5 * t;
    v[j] = per * (R(j, i) + R(i, j));
    v[k] = per * (R(k, i) + R(i, k));
    c = per * (R(k, j) - R(j, k));
  }
  if (c < 0) {
    c = -c;
    v = -v;
  }
  const Real s = v.norm();
  const Real half = c > 0.1 ? std::atan(s / c) : atan2(s, c);  // atan: half the cost
  return (s < 1e-10 ? 2.0 : 2.0 * half / s) * v;
}

Real theta_of(const Mat3& R, Real near) {
  const Real theta = atan2(R(1, 0), R(0, 0));
  if (!(fabs(near) < 1000)) return theta;
  return theta + 2 * kPi * std::nearbyint((near - theta) / (2 * kPi));
}

Vec3 tilt_keeping(Real theta, Real about_x, Real about_y) {
  const Real c = cos(theta), s = sin(theta);
  const Real product = (c * about_x + s * about_y) * (c * about_y - s * about_x);
  Vec3 w(about_x, about_y, 0);
  for (int k = 0; k < kTiltIterations; ++k) {
    const Versine ratios = versine_ratios(w.squaredNorm());
    w.z() = -product * ratios.versine / ratios.sine;
  }
  return w;
}
}  // namespace truepose
