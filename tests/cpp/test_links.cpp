// Derivatives of measured differences.
#include "truepose/offline/links.hpp"

#include "mechanisms.hpp"

using namespace mechanisms;

TEST("every kind of difference changes with poses and unknowns as it says") {
  check::Random random{17};
  for_each([&](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    const std::array<Pose, 2> poses{to_pose<K>(random_pose(mechanism, random)),
                                    to_pose<K>(random_pose(mechanism, random))};
    std::array<double, 6> w{0.02, -0.03, 0.01, 0.004, 0.03, -0.02};
    for (const LinkKind kind : {LinkKind::plane, LinkKind::distance, LinkKind::point})
      for (int axis = 0; axis < 3; ++axis) {
        Link link{kind, {0, 1}, 0, 3, axis, -1, 0, 1};
        const LinkExpected at = expected(K, link, poses.data(), w.data());
        constexpr double h = 1e-6;
        const auto slope = [&](auto&& changed) { return (changed(h) - changed(-h)) / (2 * h); };
        for (int a = 0; a < 2; ++a)
          for (int j = 0; j < n; ++j)
            CHECK_NEAR(at.H_x[a][j], slope([&](double by) {
                         std::array<Pose, 2> other = poses;
                         Coordinates step{};
                         step[j] = by;
                         other[a] = moved<K>(poses[a], step);
                         return expected(K, link, other.data(), w.data()).value;
                       }),
                       1e-8);
        for (int k = 0; k < 6; ++k)
          CHECK_NEAR(k < 3 ? at.tool[k] : at.shape[k - 3], slope([&](double by) {
                       std::array<double, 6> other = w;
                       other[k] += by;
                       return expected(K, link, poses.data(), other.data()).value;
                     }),
                     1e-8);
      }
  });
}

TEST("a block of links is the marginal of all its equations over poses and noise") {
  // Two links on three lines of a plane: poses eliminated at once, against one after another.
  check::Random random{5};
  constexpr int n = 2, p = 4;
  std::vector<Line> lines(3);
  std::vector<Pose> poses(3);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(3 * n + 2, 3 * n);  // whitened, of poses
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(3 * n + 2, p);
  Eigen::VectorXd e(3 * n + 2);
  for (int k = 0; k < 3; ++k) {
    poses[k].D = Vec3(random(), random(), 0);
    Line& line = lines[k];
    line.n = line.rows = n;
    line.B = RowMatrix::Zero(n, p);
    for (int i = 0; i < n; ++i) {
      line.e[i] = e[n * k + i] = random();
      for (int j = i; j < n; ++j) line.R[i][j] = A(n * k + i, n * k + j) = i == j ? 3 : random();
      for (int j = 0; j < p; ++j) line.B(i, j) = B(n * k + i, j) = random();
    }
  }
  Links links{{{LinkKind::distance, {0, 1}, 0, 0, 0, 0, 1.3, 0.1},
               {LinkKind::distance, {2, 1}, 0, 0, 0, 0, 0.7, 0.2}},
              {0, 0, 0},
              p - 3};
  const Knowledge known{p, nullptr, nullptr, {}};
  const auto blocks =
      linked(Mobility::planar_translation, links, links.mean.data(), known, poses, lines);
  CHECK(blocks.size() == 1);
  for (int k = 0; k < 2; ++k) {
    const Link& link = links.link[k];
    const LinkExpected at =
        expected(Mobility::planar_translation, link, poses.data(), links.mean.data());
    const int row = 3 * n + k;
    e[row] = (link.measured - at.value) / link.sigma;
    for (int a = 0; a < 2; ++a)
      for (int j = 0; j < n; ++j) A(row, n * link.line[a] + j) = at.H_x[a][j] / link.sigma;
    for (int j = 0; j < 3; ++j) B(row, links.first + j) = at.tool[j] / link.sigma;
    B(row, links.first) += at.shape[0] / link.sigma;
    B(row, links.first + 1) += at.shape[1] / link.sigma;
  }
  const Eigen::MatrixXd Q = A.householderQr().householderQ();
  const Eigen::MatrixXd rest = Q.rightCols(2).transpose();
  const Eigen::MatrixXd direct = (rest * B).transpose() * (rest * B);
  const LinkBlock& block = blocks[0];
  const Eigen::MatrixXd ours = block.B.transpose() * block.C.solve(block.B);
  CHECK((ours - direct).norm() < 1e-10 * direct.norm());
  CHECK_NEAR(block.y.dot(block.C.solve(block.y)), (rest * e).squaredNorm(), 1e-10);
  // The poses that follow from them are those of all equations at once.
  std::vector<Coordinates> nu(3);
  pull(block, Eigen::VectorXd::Zero(p), nu);
  const Eigen::VectorXd dx = A.householderQr().solve(e);
  for (int k = 0; k < 3; ++k) {
    Coordinates change{};
    for (int i = 0; i < n; ++i) change[i] = lines[k].e[i] + nu[k][i];
    back_substitute(n, lines[k].R, change);
    for (int i = 0; i < n; ++i) CHECK_NEAR(change[i], dx[n * k + i], 1e-10);
  }
}
