// The extended-to-joint matrix: inverse of M, weights of the sensors.
#include "control/tej.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

using reference::Dense;

/// M = [I; J_r J] and M⁺ = (MᵀWM)⁻¹MᵀW by their definitions: the latter by QR of √W M, which does
/// not square the condition number.
struct Explicit {
  Dense M, M_plus;
};
Explicit by_definition(const Robot& robot, const Coordinates& x) {
  const Mobility K = robot.mobility;
  const int n = dof(K);
  JointMatrix J{};
  CHECK(jacobian(Level::ideal, robot, x, J));
  Reading values;
  SensorRows jr;
  Closure closure;
  CHECK(ikm(robot, to_pose(K, x), closure));
  CHECK(rkm(robot, closure, values, jr));
  Explicit result;
  result.M = Dense::Zero(n + robot.r, n);
  result.M.topRows(n).setIdentity();
  for (int k = 0; k < robot.r; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) result.M(n + k, j) += jr[k][i] * J[i][j];
  Eigen::VectorXd root = Eigen::VectorXd::Ones(n + robot.r);
  for (int k = 0; k < robot.r; ++k) root[n + k] = std::sqrt(robot.sensor[k].weight);
  const Dense weighted = root.asDiagonal() * result.M;
  result.M_plus = reference::solve(weighted, root.asDiagonal());
  return result;
}

}  // namespace

TEST_EACH(for_each, "TEJ·M = I and TEJ = (MᵀWM)⁻¹MᵀW, for no, one and two sensors of any weight") {
  Robot robot = mechanism.robot;
  check::Random random(41);
  for (const int r : {0, 1, 2})
    for (const double weight : {0.0, 1.0, 16.0, 1e4})
      for (int k = 0; k < 20; ++k) {
        robot.r = r;
        robot.sensor[0].weight = weight;
        robot.sensor[1].weight = k % 2 == 0 ? weight : 1;
        const Coordinates x = random_pose(mechanism, random);
        ExtendedColumns M;
        ExtendedRows tej_;
        CHECK(tej(robot, x, M, tej_));
        const Explicit expected = by_definition(robot, x);
        for (int i = 0; i < n; ++i)
          for (int j = 0; j < n; ++j) {
            double product = 0;
            for (int c = 0; c < n + r; ++c) product += tej_[i][c] * M[c][j];
            CHECK_NEAR(product, i == j, 1e-12);
          }
        for (int c = 0; c < n + r; ++c)
          for (int i = 0; i < n; ++i) {
            CHECK_NEAR(M[c][i], expected.M(c, i), 1e-12);
            CHECK_NEAR(tej_[i][c], expected.M_plus(i, c), 1e-12);
          }
      }
}
