// Assembly modes: grouping of poses into modes, and their order.
#include <Eigen/Core>

#include "calibration/dense.hpp"
#include "mechanisms.hpp"
#include "simulation/assembly.hpp"

using namespace mechanisms;

namespace {

Eigen::Vector3d vector(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

TEST_EACH(for_each,
          "poses a tenth of a millimetre or a hundredth of a degree apart are modes of their own") {
  const Pose home = to_pose(K, mechanism.robot.home);
  std::vector<Pose> found{home};
  for (int j = 0; j < n; ++j) {
    Coordinates step{};
    step[j] = 1e-4;
    found.push_back(moved(K, home, step));
    step[j] = 1e-4 + 1e-9;  // another search's end there
    found.push_back(moved(K, home, step));
  }
  const std::vector<AssemblyMode> modes = distinct_modes(mechanism.robot, found);
  CHECK(std::ssize(modes) == n + 1);
  CHECK(modes.front().seen == 1);
  for (std::size_t k = 1; k < modes.size(); ++k) CHECK(modes[k].seen == 2);
}

TEST_EACH(for_each, "the mode nearest to home is told first") {
  const Pose home = to_pose(K, mechanism.robot.home);
  check::Random random(81);
  std::vector<Pose> found;
  for (int k = 0; k < 20; ++k) found.push_back(to_pose(K, random_pose(mechanism, random)));
  const std::vector<AssemblyMode> modes = distinct_modes(mechanism.robot, found);
  CHECK(modes.size() == 20);
  const auto from_home = [&](const Pose& at) {
    return std::max((vector(at.D) - vector(home.D)).cwiseAbs().maxCoeff(),
                    dense(at.R - home.R).norm());
  };
  for (std::size_t k = 1; k < modes.size(); ++k)
    CHECK(from_home(modes[k - 1].pose) <= from_home(modes[k].pose));
}

TEST_EACH(for_each, "every start is one from which the rods can reach") {
  const Robot& robot = mechanism.robot;
  Closure closure;
  CHECK(ikm(robot, to_pose(K, robot.home), closure));
  const Joint q = closure.q();
  const auto starts = random_starts(robot, q, 200, 3), again = random_starts(robot, q, 200, 3);
  CHECK(starts.size() == 201);
  Eigen::Vector3d low = Eigen::Vector3d::Constant(INFINITY), high = -low;
  for (std::size_t k = 1; k < starts.size(); ++k) {
    CHECK(vector(starts[k].D) == vector(again[k].D) && dense(starts[k].R) == dense(again[k].R));
    low = low.cwiseMin(vector(starts[k].D)), high = high.cwiseMax(vector(starts[k].D));
    for (int i = 0; i < n; ++i) {
      const Driven at = driven_point(robot.chain[i], q[i]);
      const Vec3 centre = robot.chain[i].base + at.p - robot.chain[i].anchor;
      const Eigen::Vector3d apart = vector(starts[k].D - centre);
      const int axes = dof(robot.mobility) == 2 || robot.mobility == Mobility::planar ? 2 : 3;
      CHECK(apart.head(axes).cwiseAbs().maxCoeff() <= at.rod + robot.chain[i].pivot.norm() + 1e-12);
    }
  }
  // Home has starts on all its sides.
  const Eigen::Vector3d home = vector(to_pose(K, robot.home).D);
  CHECK((low.head<2>().array() < home.head<2>().array()).all());
  CHECK((high.head<2>().array() > home.head<2>().array()).all());
}
