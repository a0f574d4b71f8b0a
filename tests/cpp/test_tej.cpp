// The extended-to-joint matrix: inverse of M, weights of the sensors.
#include "control/tej.hpp"
#include "estimation/linearise.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

using reference::Dense;

/// M = H_x J = [K J; J_r J] and M⁺ = K (H_xᵀWH_x)⁻¹H_xᵀW by their definitions, with K J = I for as
/// many motors as freedoms: by QR of √W H_x and K, which does not square the condition number.
struct Explicit {
  Dense M, M_plus;
};
Explicit by_definition(const Robot& robot, const Coordinates& x) {
  const Mobility K = robot.mobility;
  const int n = dof(K), motors = robot.motors;
  Extended q_e;
  PoseRows rows;
  CHECK(linearise(Level::ideal, robot, to_pose(K, x), q_e, rows, nullptr));
  Dense H(readings(robot), n);
  for (int c = 0; c < H.rows(); ++c)
    for (int j = 0; j < n; ++j) H(c, j) = rows[c][j];
  const Dense K_q = H.topRows(motors);
  Eigen::VectorXd root = Eigen::VectorXd::Ones(readings(robot));
  for (int k = 0; k < robot.r; ++k) root[motors + k] = std::sqrt(robot.sensor[k].weight);
  Explicit result;
  result.M = H * reference::solve(K_q, Dense::Identity(motors, motors));
  result.M_plus = K_q * reference::solve(root.asDiagonal() * H, root.asDiagonal());
  return result;
}

}  // namespace

TEST_EACH(
    for_each,
    "TEJ·M = I (with redundant motors K J) and TEJ = K (HᵀWH)⁻¹HᵀW, for sensors of any weight") {
  Robot robot = mechanism.robot;
  check::Random random(41);
  for (const int r : {0, 1, 2})
    for (const double weight : {0.0, 1.0, 16.0, 1e4})
      for (int k = 0; k < 20; ++k) {
        robot.r = r;
        robot.sensor[0].weight = weight;
        robot.sensor[1].weight = k % 2 == 0 ? weight : 1;
        const Coordinates x = any_x(random);
        ExtendedColumns M;
        ExtendedRows tej_;
        CHECK(tej(robot, x, M, tej_));
        const Explicit expected = by_definition(robot, x);
        for (int i = 0; i < motors; ++i)
          for (int j = 0; j < motors; ++j) {
            double product = 0;
            for (int c = 0; c < motors + r; ++c) product += tej_[i][c] * M[c][j];
            CHECK_NEAR(product, expected.M(i, j), 1e-12);
            if (motors == n) CHECK(M[i][j] == (i == j));
          }
        for (int c = 0; c < motors + r; ++c)
          for (int i = 0; i < motors; ++i) {
            CHECK_NEAR(M[c][i], expected.M(c, i), 1e-12);
            CHECK_NEAR(tej_[i][c], expected.M_plus(i, c), 1e-12);
          }
      }
}
