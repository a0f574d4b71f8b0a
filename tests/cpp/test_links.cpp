// Derivatives of measured differences.
#include "calibration/links.hpp"

#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

/// Rows whose poses are known a little, and links of every kind between them: row 4 has no pose,
/// rows 5 and 6 share no link with the others.
struct Scene {
  static constexpr Mobility K = Mobility::translation;
  static constexpr int n = dof(K), L = 7, p = 10;
  std::vector<Line> lines{L};
  std::vector<Pose> poses{L};
  Links links{{{LinkKind::plane, {0}, 0, 3, 1, 0, 0.1, 0.2},
               {LinkKind::distance, {0, 1}, 0, 6, 0, -1, 1.3, 0.1},
               {LinkKind::distance, {0, 4}, 0, 6, 0, 1, 1.1, 0.1},
               {LinkKind::point, {2, 1}, 0, 0, 2, 0, -0.2, 0.4},
               {LinkKind::plane, {3}, 0, 3, 0, 0, -0.3, 0.5},
               {LinkKind::distance, {4, 0}, 0, 6, 0, 0, 0.9, 0.1},
               {LinkKind::distance, {2, 3}, 0, 6, 0, 1, 0.7, 0.3},
               {LinkKind::plane, {4}, 0, 3, 2, 0, 0.2, 0.2},
               {LinkKind::distance, {6, 5}, 0, 6, 0, 0, 0.8, 0.2},
               {LinkKind::plane, {5}, 0, 3, 2, 0, 0.4, 0.3}},
              {0.1, -0.2, 0.3, 0.02, 0.05, -0.04, 0.1, 0.05},
              p - 8};
  reference::Rows root = reference::Rows::Zero(p, p);
  Knowledge known{p, nullptr, nullptr, {}};

  explicit Scene(bool in_units_of_knowledge = true) {
    check::Random random(5);
    for (int k = 0; k < L; ++k) {
      poses[k].D = Vec3(random(), random(), random());
      Line& line = lines[k];
      line.n = n;
      line.rows = k == 4 ? 0 : n;
      line.B = RowMatrix(n, p);
      for (int i = 0; i < n; ++i) {
        line.e[i] = random();
        for (int j = i; j < n; ++j) line.R[i][j] = i == j ? 2 + 8 * k : random();
        for (int j = 0; j < p; ++j) line.B(i, j) = random();
      }
    }
    for (int k = 0; k < p; ++k) root(k, k) = 0.1 * (1 + k % 4);
    if (in_units_of_knowledge) known.root = root.data();
  }
  std::vector<LinkBlock> blocks() const {
    return linked(K, links, links.mean.data(), known, poses, lines);
  }
};

/// All equations of a scene at once, in poses and unknowns u, the prior's |u|² among them.
struct AtOnce {
  static constexpr int size = Scene::n * Scene::L + Scene::p;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(size, size);  ///< of rows and prior, then of links
  Eigen::VectorXd e = Eigen::VectorXd::Zero(size);
  Eigen::MatrixXd of_link;
  Eigen::VectorXd e_link;

  explicit AtOnce(const Scene& scene)
      : of_link(Eigen::MatrixXd::Zero(scene.links.link.size(), size)),
        e_link(scene.links.link.size()) {
    constexpr int n = Scene::n, first = n * Scene::L;
    A.diagonal().setOnes();  // of a row without a pose: nothing moves it
    for (int k = 0; k < Scene::L; ++k)
      for (int i = 0; i < scene.lines[k].rows; ++i) {
        e[n * k + i] = scene.lines[k].e[i];
        for (int j = 0; j < n; ++j) A(n * k + i, n * k + j) = scene.lines[k].R[i][j];
        A.row(n * k + i).tail<Scene::p>() = reference::dense(scene.lines[k].B).row(i);
      }
    for (int k = 0; k < of_link.rows(); ++k) {
      const Link& link = scene.links.link[k];
      const LinkExpected at = expected(Scene::K, link, scene.poses.data(), scene.links.mean.data());
      e_link[k] = (link.measured - at.value) / link.sigma;
      for (int a = 0; a < link.ends(); ++a)
        for (int j = 0; j < n; ++j) of_link(k, n * link.line[a] + j) += at.H_x[a][j] / link.sigma;
      for (int j = 0; j < 6; ++j) {
        const double slope = j < 3 ? at.tool[j] : at.shape[j - 3];
        const int column = scene.links.first + (j < 3 ? link.tool + j : link.shape + j - 3);
        if (slope == 0) continue;
        const double unit = scene.known.root ? scene.root(column, column) : 1;
        of_link(k, first + column) += slope * unit / link.sigma;
      }
    }
  }
  /// Enters a link with this weight.
  void enter(int k, double weight) {
    A.conservativeResize(A.rows() + 1, size);
    e.conservativeResize(A.rows());
    A.bottomRows(1) = std::sqrt(weight) * of_link.row(k);
    e[e.size() - 1] = std::sqrt(weight) * e_link[k];
  }
  Eigen::VectorXd best() const { return reference::solve(A, e); }
  Eigen::MatrixXd covariance() const { return reference::inverse(A.transpose() * A); }
};

}  // namespace

TEST_EACH(for_each, "every kind of difference changes with poses and unknowns as it says") {
  check::Random random{17};
  const std::array<Pose, 2> poses{any_pose(random), any_pose(random)};
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
                       other[a] = moved(K, poses[a], step);
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
}

TEST("a plane slopes along the axis after its own and the one after that, cyclically") {
  const Pose pose;
  for (int axis = 0; axis < 3; ++axis) {
    const Link link{LinkKind::plane, {0}, 0, 3, axis};
    const int next = (axis + 1) % 3, after = (axis + 2) % 3;
    std::array<double, 6> w{0, 0, 0, 0.1, 0.2, 0.3};
    w[next] = 0.5, w[after] = -0.7;
    w[axis] = 0.1 + 0.2 * w[next] + 0.3 * w[after];  // a tool point of the plane
    CHECK_NEAR(expected(Mobility::translation, link, &pose, w.data()).value, 0, 1e-15);
  }
}

TEST("a length from middle to middle does not depend on the width of a printed line") {
  const std::array<Pose, 2> poses{Pose{}, Pose{Vec3(0.3, 0.4, 0)}};
  std::array<double, 5> w{0, 0, 0, 0.01, 0.2};
  Link link{LinkKind::distance, {0, 1}, 0, 3};
  CHECK_NEAR(expected(Mobility::translation, link, poses.data(), w.data()).value, 0.505, 1e-15);
  link.times = 1;
  CHECK_NEAR(expected(Mobility::translation, link, poses.data(), w.data()).value, 0.705, 1e-15);
}

TEST("links that share no row are apart, and those of a row without a pose are ignored") {
  const std::vector<LinkBlock> blocks = Scene().blocks();
  CHECK(blocks.size() == 2);
  CHECK((blocks[0].link == std::vector<int>{0, 1, 3, 4, 6}));
  CHECK((blocks[1].link == std::vector<int>{8, 9}));
}

TEST("parameters, poses and links left out are those of all equations at once") {
  for (const bool in_units : {true, false}) {
    const Scene scene(in_units);
    std::vector<LinkBlock> blocks = scene.blocks();
    const AtOnce none(scene);
    AtOnce all = none;
    std::vector<double> weight(scene.links.link.size(), 1);
    weight[1] = 0.5, weight[4] = kNothing, weight[9] = 0.2;
    Eigen::MatrixXd information = Eigen::MatrixXd::Identity(Scene::p, Scene::p);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(Scene::p);
    for (LinkBlock& block : blocks) {
      Eigen::VectorXd by(block.size());
      for (int k = 0; k < block.size(); ++k) {
        by[k] = weight[block.link[k]];
        all.enter(block.link[k], by[k]);
      }
      block.weigh(reference::list(by));
      const auto L = reference::dense(block.C), B = reference::dense(block.B);
      const Eigen::MatrixXd weights = reference::inverse(L * L.transpose());
      information += B.transpose() * weights * B;
      right += B.transpose() * weights * reference::dense(block.y);
    }
    const Eigen::VectorXd u = reference::solve(information, right), best = all.best();
    CHECK((u - best.tail<Scene::p>()).norm() < 1e-9);
    const Eigen::MatrixXd covariance = all.covariance().bottomRightCorner<Scene::p, Scene::p>();
    CHECK((reference::inverse(information) - covariance).norm() < 1e-9);
    std::vector<Line> pulled(Scene::L);
    for (const LinkBlock& block : blocks) pull(block, reference::list(u), pulled);
    for (int k = 0; k < Scene::L; ++k) {
      if (scene.lines[k].rows == 0) continue;
      Coordinates change{};
      for (int i = 0; i < Scene::n; ++i)
        change[i] = scene.lines[k].e[i] - reference::dense(scene.lines[k].B).row(i).dot(u) +
                    pulled[k].pull[i];
      back_substitute(Scene::n, scene.lines[k].R, change);
      for (int i = 0; i < Scene::n; ++i) CHECK_NEAR(change[i], best[Scene::n * k + i], 1e-9);
    }

    std::vector<LinkResult> result(scene.links.link.size());
    for (LinkBlock& block : blocks) {
      // As linearised where the search ended.
      block.y = reference::list(reference::dense(block.y) - reference::dense(block.B) * u);
      cross_validate(scene.links, block, cholesky(reference::plain(information)), result);
    }
    for (const int k : {2, 5, 7}) CHECK(std::isnan(result[k].left_out) && result[k].weight == 0);
    for (const LinkBlock& block : blocks)
      for (const int k : block.link) {
        AtOnce others = none;
        for (const LinkBlock& each : blocks)
          for (const int other : each.link)
            if (other != k) others.enter(other, weight[other]);
        const double sigma = scene.links.link[k].sigma;
        const double left_out = none.e_link[k] - none.of_link.row(k).dot(others.best());
        const double spread =
            1 + none.of_link.row(k) * others.covariance() * none.of_link.row(k).transpose();
        CHECK_NEAR(result[k].residual, sigma * none.e_link[k], 1e-12);
        CHECK_NEAR(result[k].left_out, sigma * left_out, 1e-6);
        CHECK_NEAR(result[k].sigma, sigma * std::sqrt(spread), 1e-6);
      }
  }
}

TEST("under a robust loss a block has the lowest cost of all its poses, each link its own weight") {
  Scene scene;
  scene.links.link[3].measured += 50;
  const RowLoss loss{1};
  for (LinkBlock& block : scene.blocks()) {
    block.weigh(loss, std::vector<char>(scene.links.link.size()));
    std::vector<Line> pulled(Scene::L);
    pull(block, std::vector<double>(Scene::p), pulled);
    std::vector<Coordinates> nu;
    for (const Line& line : pulled) nu.push_back(line.pull);
    const auto own = [&] {
      std::vector<double> own = block.y;  // ε
      for (std::size_t a = 0; a < block.end.size(); ++a)
        for (int i = 0; i < Scene::n; ++i)
          own[block.end[a].link] -= block.G(a, i) * nu[block.end[a].line][i];
      return own;
    };
    const auto cost = [&] {
      double sum = 0;
      for (const Coordinates& of : nu)
        for (const double part : of) sum += part * part;
      for (const double each : own()) sum += loss.cost(each * each, 1);
      return sum;
    };
    CHECK_NEAR(block.cost, cost(), 1e-9 * cost());
    const std::vector<double> at_best = own();
    for (int k = 0; k < block.size(); ++k)
      CHECK_NEAR(block.weight[k], std::max(loss.weight(at_best[k] * at_best[k], 1), kNothing),
                 1e-8);
    constexpr double h = 1e-5;
    for (Coordinates& of : nu)
      for (int i = 0; i < Scene::n; ++i) {
        of[i] += h;
        const double up = cost();
        of[i] -= 2 * h;
        const double down = cost();
        of[i] += h;
        CHECK_NEAR((up - down) / (2 * h), 0, 1e-5);
      }
  }
}
