// Assembly modes: all poses for the same motor positions, by searches from many random poses.
#include "simulation/assembly.hpp"

namespace truepose {
std::vector<Pose> random_starts(const Robot& robot, const Joint& q, int count, std::uint64_t seed) {
  const Mobility mobility = robot.mobility;
  Vec3 low(-INFINITY, -INFINITY, -INFINITY), high = -low;
  for (int i : range(robot.motors)) {
    const Chain& chain = robot.chain[i];
    const Driven driven = driven_point(chain, q[i]);
    const Vec3 centre = chain.base + driven.p - chain.anchor;
    const Real reach = driven.rod + chain.pivot.norm();
    for (int axis : range(3)) {
      low[axis] = max(low[axis], centre[axis] - reach);
      high[axis] = min(high[axis], centre[axis] + reach);
    }
  }
  std::mt19937_64 generator(seed);
  const auto uniform = [&] { return double(generator() >> 11) * 0x1p-53; };
  const Pose home = to_pose(robot.mobility, robot.home);
  std::vector<Pose> starts(std::size_t(count) + 1, home);
  for (auto start = starts.begin() + 1; start != starts.end(); ++start) {
    if (is_rotational(mobility)) {  // angles, uniform over a whole turn
      for (int axis : range(dof(mobility))) start->D[axis] = kPi * (2 * uniform() - 1);
      continue;
    }
    for (int axis : range(3)) start->D[axis] = low[axis] + uniform() * (high[axis] - low[axis]);
    if (mobility == Mobility::planar || mobility == Mobility::planar_translation)
      start->D.z() = home.D.z();
    if (turns_about_z(mobility)) {
      start->theta = kPi * (2 * uniform() - 1);
      start->R = rotation_z(start->theta);
    } else if (mobility == Mobility::spatial) {  // uniform on the sphere of quaternions
      const double part = uniform(), a = 2 * kPi * uniform(), b = 2 * kPi * uniform();
      const double r = sqrt(1 - part), s = sqrt(part);
      const double w = s * cos(b);
      const Vec3 v(r * sin(a), r * cos(a), s * sin(b));
      start->R = rodrigues(w * w - v.squaredNorm(), 2 * w * v, 2 * v, v);
    }
  }
  return starts;
}

std::vector<AssemblyMode> distinct_modes(const Robot& robot, std::vector<Pose> found) {
  if (is_rotational(robot.mobility))
    for (Pose& pose : found)
      for (int axis : range(dof(robot.mobility))) pose.D[axis] = remainder(pose.D[axis], 2 * kPi);
  const auto apart = [](const Pose& a, const Pose& b) {
    const Vec3 D = a.D - b.D;
    return max({fabs(D.x()), fabs(D.y()), fabs(D.z()), (a.R - b.R).norm()});
  };
  // A projection on unit vectors in which distinct modes are unlikely to coincide.
  const auto along = [](const Pose& at) {
    return at.D.dot(Vec3(0.36, 0.48, 0.8)) + at.R.col(0).dot(Vec3(0.48, -0.6, 0.64)) +
           at.R.col(1).dot(Vec3(-0.64, 0.48, 0.6));
  };
  constexpr double kWindow = 5 * kSameMode;  // |Δ along| ≤ √3 |ΔD|∞ + √2 |ΔR|
  std::ranges::sort(found, [&](const Pose& a, const Pose& b) { return along(a) < along(b); });
  std::vector<AssemblyMode> modes;
  for (const Pose& pose : found) {
    std::size_t k = modes.size();
    bool known = false;
    while (!known && k > 0 && along(pose) - along(modes[k - 1].pose) < kWindow)
      known = apart(pose, modes[--k].pose) < kSameMode;
    if (known)
      ++modes[k].seen;
    else
      modes.push_back({pose});
  }
  const Pose home = to_pose(robot.mobility, robot.home);
  std::ranges::stable_sort(modes, [&](const AssemblyMode& a, const AssemblyMode& b) {
    return apart(a.pose, home) < apart(b.pose, home);
  });
  if (turns_about_z(robot.mobility))
    for (AssemblyMode& mode : modes) mode.pose.theta = theta_of(mode.pose.R, 0);
  return modes;
}
}  // namespace truepose
