// One row of readings as equations in ξ, missing ones left out and outside ones put in.
#include "calibration/line.hpp"

#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

/// What a line says of ξ: information on u and its right side, the pose eliminated; and χ².
struct Says {
  Eigen::MatrixXd information;
  Eigen::VectorXd right;
  double chi2;
};

Says says(const Line& line) {
  const Eigen::MatrixXd B = reference::dense(line.B).middleRows(line.n, line.redundancy());
  const Eigen::Map<const Eigen::VectorXd> e(line.e.data() + line.n, line.redundancy());
  return {B.transpose() * B, B.transpose() * e, line.chi2()};
}

/// The same from whitened rows A δx + B δu = e, densely.
Says says(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B, const Eigen::VectorXd& e) {
  const Eigen::MatrixXd N = reference::complement(A);
  const Eigen::MatrixXd NB = N * B;
  return {NB.transpose() * NB, NB.transpose() * (N * e), (N * e).squaredNorm()};
}

void check_same(const Says& a, const Says& b) {
  CHECK((a.information - b.information).norm() < 1e-9 * b.information.norm());
  CHECK((a.right - b.right).norm() < 1e-9 * b.right.norm());
  CHECK_NEAR(a.chi2, b.chi2, 1e-9 * b.chi2);
}

/// A robot with both sensors, readings of it that disagree a little, and knowledge of it in which
/// every reading has a σ of its own. Behind the parameters: unknowns of a registration, if asked.
class Scene {
  check::Random random{61};  // first: what follows draws from it

 public:
  Robot robot;
  const Mobility K = robot.mobility;
  const int n = dof(K);
  Pose pose;
  Extended q_e{}, expected{};
  Knowledge known;
  PoseRows H_x{};
  reference::Rows H_xi;
  Parasitic rest;

  explicit Scene(const Mechanism& mechanism, bool registration = false)
      : robot(with_both(mechanism)),
        pose(to_pose(K, random_pose(mechanism, random))),
        H_xi(2 * readings(), parameter_count(robot)),
        prior_(robot) {
    const Knowledge of_robot = prior_.known();
    column.assign(of_robot.column, of_robot.column + of_robot.count);
    if (registration) column.insert(column.end(), kRegistration, -1);
    const int p = static_cast<int>(column.size());
    root = reference::Rows::Zero(p, p);
    for (int k = 0; k < p; ++k) root(k, k) = 1e-3 * (1 + k % 4);
    for (int k = 1; k < of_robot.count; ++k) root(k, k - 1) = 4e-4 * random();
    known = {p, column.data(), root.data(), {}};
    for (double& sigma : known.sigma) sigma = 1e-5 * (2 + random());
    CHECK(linearise(Level::ideal, robot, pose, expected, H_x, H_xi.data()));
    for (int c = 0; c < readings(); ++c) q_e[c] = expected[c] + 3 * known.sigma[c] * random();
  }
  int readings() const { return robot.motors + robot.r; }
  int parameters() const { return prior_.known().count; }

  Line read(const Outside& outside = {}) {
    Line line;
    reference::Rows work(2 * readings(), parameter_count(robot));
    CHECK(linearise_line(Level::ideal, robot, known, pose, q_e.data(), outside, {}, work.data(),
                         line, rest));
    return line;
  }
  /// Reading c, whitened, as row `at` of A δx + B δu = e.
  void enter(int c, int at, Eigen::MatrixXd& A, Eigen::MatrixXd& B, Eigen::VectorXd& e) const {
    for (int j = 0; j < n; ++j) A(at, j) = H_x[c][j] / known.sigma[c];
    Eigen::RowVectorXd H = Eigen::RowVectorXd::Zero(known.count);
    for (int k = 0; k < parameters(); ++k) H[k] = H_xi(c, column[k]) / known.sigma[c];
    B.row(at) = H * root;
    e[at] = (q_e[c] - expected[c]) / known.sigma[c];
  }

 private:
  static Robot with_both(const Mechanism& mechanism) {
    Robot robot = mechanism.robot;
    robot.r = 2;
    return robot;
  }
  mutable Prior prior_;
  std::vector<int> column;
  reference::Rows root;
};

}  // namespace

TEST_EACH(for_each, "a reading that was not taken leaves the others' equations as they are") {
  Scene scene(mechanism);
  const int rows = scene.readings(), p = scene.known.count;
  for (int missing = 0; missing < rows; ++missing) {
    const double taken = scene.q_e[missing];
    Eigen::MatrixXd A(rows - 1, n), B(rows - 1, p);
    Eigen::VectorXd e(rows - 1);
    for (int c = 0, at = 0; c < rows; ++c)
      if (c != missing) scene.enter(c, at++, A, B, e);
    scene.q_e[missing] = NAN;
    const Line line = scene.read();
    CHECK(line.redundancy() == motors - n + 1);
    check_same(says(line), says(A, B, e));
    scene.q_e[missing] = taken;
  }
}

TEST("a line with fewer readings than freedoms determines no pose") {
  Scene scene(five_bar());
  for (int c = 0; c < 3; ++c) scene.q_e[c] = NAN;
  Line line;
  reference::Rows work(2 * scene.readings(), parameter_count(scene.robot));
  const Outcome outcome = linearise_line(Level::ideal, scene.robot, scene.known, scene.pose,
                                         scene.q_e.data(), {}, {}, work.data(), line, scene.rest);
  CHECK(outcome.status == Status::singular);
}

TEST_EACH(
    for_each,
    "each coordinate measured from outside counts with its own σ, one that was not does not") {
  Scene scene(mechanism);
  const int readings = scene.readings(), p = scene.known.count;
  // In the base frame, of the nacelle's own coordinates: a step of the pose is one of them.
  const Coordinates x = to_coordinates(K, scene.pose);
  Coordinates measured = x, sigma{};
  for (int i = 0; i < n; ++i) sigma[i] = 1e-5 * (1 + 2 * i);
  // Rotation vectors have no differences; they are measured as they are.
  for (int i = 0; i < std::min(n, 4); ++i)
    if (K != Mobility::spatial || i < 3) measured[i] += (2 - i) * sigma[i];
  for (const bool all : {true, false}) {
    if (!all) measured[0] = NAN;
    const int rows = readings + n - !all;
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows, n), B = Eigen::MatrixXd::Zero(rows, p);
    Eigen::VectorXd e(rows);
    for (int c = 0; c < readings; ++c) scene.enter(c, c, A, B, e);
    for (int i = !all, at = readings; i < n; ++i, ++at) {
      A(at, i) = 1 / sigma[i];
      e[at] = (measured[i] - x[i]) / sigma[i];
    }
    Outside outside;
    outside.x = measured.data(), outside.sigma = sigma.data();
    const Line line = scene.read(outside);
    CHECK(line.redundancy() == rows - n);
    check_same(says(line), says(A, B, e));
  }
}

TEST_EACH(for_each, "an unknown registration is seen by what was measured, and by nothing else") {
  Scene scene(mechanism, true);
  const int readings = scene.readings(), p = scene.known.count, first = scene.parameters();
  Registration by;
  by.base = {Vec3(0.5, -0.3, 0.2), exp_so3(Vec3(0.1, -0.2, 0.4))};
  by.marker.t = Vec3(0.03, -0.02, 0.05);
  Joint sigma{};
  for (int i = 0; i < n; ++i) sigma[i] = 1e-4 * (1 + 2 * i);
  Joint spread = sigma;  // θ's, less certain the nearer the marker's x axis is to the tracker's z
  const Seen here = seen(K, by, scene.pose);
  const Vec3 a = here.Q.col(0);
  if (turns_about_z(K)) spread[n - 1] /= std::hypot(a.x(), a.y());
  const Joint nothing{};
  const Coordinates there = innovation(K, here, nothing.data());
  Joint measured{};
  for (int i = 0; i < n; ++i) measured[i] = -there[i];
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(readings + n, n);
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(readings + n, p);
  Eigen::VectorXd e = Eigen::VectorXd::Zero(readings + n);
  for (int c = 0; c < readings; ++c) scene.enter(c, c, A, B, e);
  if (K == Mobility::spatial) return;  // its rotation vectors have no such differences
  // By test_registration the derivatives are those of finite differences.
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) A(readings + i, j) = here.H_x[i][j] / spread[i];
    for (int j = 0; j < kRegistration; ++j)
      B(readings + i, first + j) =
          scene.known.root[(first + j) * (p + 1)] * here.H[i][j] / spread[i];
  }
  Outside outside;
  outside.x = measured.data(), outside.sigma = sigma.data();
  outside.registration = &by, outside.first = first;
  const Says found = says(scene.read(outside)), expected = says(A, B, e);
  CHECK((found.information - expected.information).norm() < 1e-7 * expected.information.norm());
  CHECK_NEAR(found.chi2, expected.chi2, 1e-7 * expected.chi2);
}
