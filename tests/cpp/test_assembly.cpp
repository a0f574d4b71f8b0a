// Assembly modes: grouping of poses into modes, and their order.
#include "mechanisms.hpp"
#include "simulation/assembly.hpp"

using namespace mechanisms;

namespace {

/// The largest of the first entries.
double largest(const Vec3& v, int count = 3) {
  double most = 0;
  for (int axis = 0; axis < count; ++axis) most = std::max(most, std::fabs(v[axis]));
  return most;
}

}  // namespace

TEST_EACH(for_each,
          "poses a tenth of a millimetre or a hundredth of a degree apart are modes of their own") {
  const Pose home = to_pose(K, robot.home);
  std::vector<Pose> found{home};
  for (int j = 0; j < n; ++j) {
    Coordinates step{};
    step[j] = 1e-4;
    found.push_back(moved(K, home, step));
    step[j] = 1e-4 + 1e-9;  // another search's end there
    found.push_back(moved(K, home, step));
  }
  const std::vector<AssemblyMode> modes = distinct_modes(robot, found);
  CHECK(std::ssize(modes) == n + 1);
  CHECK(modes.front().seen == 1);
  for (std::size_t k = 1; k < modes.size(); ++k) CHECK(modes[k].seen == 2);
}

TEST_EACH(for_each, "the mode nearest to home is told first") {
  const Pose home = to_pose(K, robot.home);
  check::Random random(81);
  std::vector<Pose> found;
  for (int k = 0; k < 20; ++k) found.push_back(any_pose(random));
  const std::vector<AssemblyMode> modes = distinct_modes(robot, found);
  CHECK(modes.size() == 20);
  const auto from_home = [&](const Pose& at) {
    return std::max(largest(at.D - home.D), (at.R - home.R).norm());
  };
  for (std::size_t k = 1; k < modes.size(); ++k)
    CHECK(from_home(modes[k - 1].pose) <= from_home(modes[k].pose));
}

TEST_EACH(for_each, "every start is one from which the rods can reach") {
  Closure closure;
  CHECK(ikm(robot, to_pose(K, robot.home), closure));
  const Joint q = closure.q();
  const auto starts = random_starts(robot, q, 200, 3), again = random_starts(robot, q, 200, 3);
  CHECK(starts.size() == 201);
  Vec3 low(INFINITY, INFINITY, INFINITY), high = -low;
  for (std::size_t k = 1; k < starts.size(); ++k) {
    CHECK((starts[k].D - again[k].D).norm() == 0 && (starts[k].R - again[k].R).norm() == 0);
    for (int axis = 0; axis < 2; ++axis) {
      low[axis] = std::min(low[axis], starts[k].D[axis]);
      high[axis] = std::max(high[axis], starts[k].D[axis]);
    }
    for (int i = 0; i < n; ++i) {
      const Driven at = driven_point(robot.chain[i], q[i]);
      const Vec3 centre = robot.chain[i].base + at.p - robot.chain[i].anchor;
      const int axes = dof(robot.mobility) == 2 || robot.mobility == Mobility::planar ? 2 : 3;
      CHECK(largest(starts[k].D - centre, axes) <= at.rod + robot.chain[i].pivot.norm() + 1e-12);
    }
  }
  // Home has starts on all its sides.
  const Vec3 home = to_pose(K, robot.home).D;
  for (int axis = 0; axis < 2; ++axis) CHECK(low[axis] < home[axis] && high[axis] > home[axis]);
}
