// The extended-to-joint matrix: inverse of M, weights of the sensors.
#include "mechanisms.hpp"
#include "reference.hpp"
#include "truepose/control/tej.hpp"

using namespace mechanisms;

namespace {

using reference::Dense;

/// M = [I; J_r J] and M⁺ = (MᵀWM)⁻¹MᵀW by their definitions: the latter by QR of √W M, which does
/// not square the condition number.
struct Explicit {
  Dense M, M_plus;
};
template <Mobility K>
Explicit by_definition(const Robot& robot, const Joint& x) {
  constexpr int n = kDof<K>;
  JointMatrix J{};
  CHECK(jacobian(robot, x, J));
  Reading values;
  Matrix<kMaxSensors, kDof<K>> jr;
  Closure<K> closure;
  CHECK(ikm<K>(robot, to_pose<K>(x), closure));
  CHECK(rkm<K>(robot, closure, values, jr));
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

TEST("TEJ·M = I and TEJ = (MᵀWM)⁻¹MᵀW, for no, one and two sensors of any weight") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Robot robot = mechanism.robot;
    check::Random random(41);
    for (const int r : {0, 1, 2})
      for (const double weight : {0.0, 1.0, 16.0, 1e4})
        for (int k = 0; k < 20; ++k) {
          robot.r = r;
          robot.sensor[0].weight = weight;
          robot.sensor[1].weight = k % 2 == 0 ? weight : 1;
          const Joint x = random_pose(mechanism, random);
          ExtendedColumns M;
          ExtendedRows tej_;
          CHECK(tej(robot, x, M, tej_));
          const Explicit expected = by_definition<K>(robot, x);
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
  });
}

TEST("a sensor of weight 0 is not there, and one of great weight is obeyed") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Robot robot = mechanism.robot;
    ExtendedColumns M;
    ExtendedRows unweighted, obeyed;
    robot.sensor[0].weight = 0;
    CHECK(tej(robot, robot.home, M, unweighted));
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(unweighted[i][n], 0, 0);
      for (int j = 0; j < n; ++j) CHECK_NEAR(unweighted[i][j], i == j, 0);
    }
    // g·(M⁺ e) is what the sensor would still miss of e: all of its own reading is obeyed.
    robot.sensor[0].weight = 1e8;
    CHECK(tej(robot, robot.home, M, obeyed));
    for (int c = 0; c <= n; ++c) {
      double follows = 0;
      for (int i = 0; i < n; ++i) follows += M[n][i] * obeyed[i][c];
      CHECK_NEAR(follows, c == n, 1e-6);
    }
  });
}

TEST("at rest the paper's law leaves e_θ0 / (1 + w|j|²) of a sensor's error") {
  const Robot nominal = h4().robot;
  for (const double weight : {1.0, 16.0}) {
    Robot robot = nominal;
    robot.sensor[0].weight = weight;
    ExtendedColumns M;
    ExtendedRows M_plus;
    CHECK(tej(robot, robot.home, M, M_plus));
    const auto& j = M[4];  // the θ row of J
    double square = 0, rest = 0;
    for (int i = 0; i < 4; ++i) square += j[i] * j[i];
    // M⁺[e_q; e_θ] = 0 for e_q = -w jᵀe_θ; then e_θ = e_θ0 + j·e_q.
    const double e_theta = 1 / (1 + weight * square);
    Joint e_q{};
    for (int i = 0; i < 4; ++i) e_q[i] = -weight * j[i] * e_theta;
    for (int i = 0; i < 4; ++i) {
      double modified = M_plus[i][4] * e_theta;
      for (int c = 0; c < 4; ++c) modified += M_plus[i][c] * e_q[c];
      CHECK_NEAR(modified, 0, 1e-14);
      rest += j[i] * e_q[i];
    }
    CHECK_NEAR(1 + rest, e_theta, 1e-14);
  }
}
