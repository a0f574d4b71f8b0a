// The estimate as the optimum of all readings, and the elimination of the pose.
#include "calibration/bound.hpp"
#include "estimation/linearise.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

/// A robot with two sensors, uncertain in every parameter of its chains, correlated as after a
/// calibration.
struct Scene {
  Robot robot;
  std::vector<int> column;
  reference::Rows root;
  Knowledge known;
  std::vector<double> work;

  Scene(const Mechanism& mechanism, check::Random& random) : robot(mechanism.robot) {
    robot.r = 2;
    for (int i = 0; i < robot.motors; ++i)
      for (int k = 0; k < 11; ++k) {
        const bool rigid = robot.chain[i].actuator != Actuator::revolute;
        if (rigid && k == static_cast<int>(ChainParameter::arm)) continue;
        column.push_back(chain_column(i) + k);
      }
    const int p = static_cast<int>(column.size());
    root = reference::Rows::Zero(p, p);
    for (int k = 0; k < p; ++k) {
      for (int j = 0; j < k; ++j) root(k, j) = 2e-5 * random();
      root(k, k) = 3e-4 * (1.5 + random());
    }
    known = {p, column.data(), root.data(), {}};
    for (double& sigma : known.sigma) sigma = 1e-4 * (1.5 + random());
    work.resize(estimate_work(robot, p));
  }
};

struct Dense {
  Eigen::MatrixXd H, B, C;  ///< H_x; H_ξ S; B Bᵀ + Σ_s
};

Dense dense(Level level, const Scene& scene, const Pose& pose) {
  const int n = dof(scene.robot.mobility);
  const int rows = readings(scene.robot), p = scene.known.count;
  const int width = parameter_count(scene.robot);
  Extended q_e;
  PoseRows H_x;
  reference::Rows H_xi(rows, width);
  Parasitic rest;
  CHECK(linearise(level, scene.robot, pose, q_e, H_x, H_xi.data(), &rest));
  Dense result{Eigen::MatrixXd(rows, n), Eigen::MatrixXd(rows, p), {}};
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < n; ++j) result.H(i, j) = H_x[i][j];
    for (int k = 0; k < p; ++k) result.B(i, k) = H_xi(i, scene.column[k]);
  }
  result.B *= scene.root;
  result.C = result.B * result.B.transpose();
  for (int i = 0; i < rows; ++i) result.C(i, i) += scene.known.sigma[i] * scene.known.sigma[i];
  return result;
}

}  // namespace

TEST_EACH(for_each_model,
          "fuse is generalised least squares: gain and covariance against dense algebra") {
  check::Random random(5);
  Scene scene(mechanism, random);
  const Robot& robot = scene.robot;
  const Pose pose = any_pose(random);
  const Dense at = dense(level, scene, pose);
  const Eigen::MatrixXd weights = reference::inverse(at.C);
  const Eigen::MatrixXd P = reference::inverse(at.H.transpose() * weights * at.H);
  const Eigen::MatrixXd gain = P * at.H.transpose() * weights;

  Extended q_e;
  PoseRows H_x;
  ReadingCovariance C;
  Fusion fusion;
  const int rows = readings(robot);
  Parasitic rest;
  CHECK(linearise(level, robot, pose, q_e, H_x, scene.work.data(), &rest));
  CHECK(reading_covariance(robot, scene.known, scene.work.data(),
                           scene.work.data() + rows * parameter_count(robot), C));
  CHECK(fuse(robot, scene.known, C, H_x, fusion));
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j)
      CHECK_NEAR(fusion.covariance[i][j], P(i, j), 1e-7 * std::sqrt(P(i, i) * P(j, j)));
    for (int c = 0; c < rows; ++c)
      CHECK_NEAR(fusion.gain[i][c], gain(i, c), 1e-7 * gain.row(i).cwiseAbs().maxCoeff());
  }
  PoseError error;
  CHECK(bool(pose_error(level, robot, scene.known, pose, {}, scene.work, error)));
  const auto geometry = reference::dense(error.by_geometry);
  const Eigen::MatrixXd sum = geometry * geometry.transpose() + reference::dense(error.by_noise);
  CHECK((sum - P).norm() < 1e-7 * P.norm());
  // Two influences, in the place of the last two parameters, act as these do.
  reference::Rows pattern(rows, 2);
  for (int c = 0; c < rows; ++c)
    for (int j = 0; j < 2; ++j)
      pattern(c, j) =
          scene.work[c * parameter_count(robot) + scene.known.column[scene.known.count - 2 + j]];
  PoseError same;
  CHECK(bool(pose_error(level, robot, scene.known, pose, {2, pattern.data()}, scene.work, same)));
  CHECK((reference::dense(same.by_geometry) - geometry).norm() < 1e-12 * geometry.norm());
}

TEST_EACH(
    for_each_model,
    "the estimate leaves no residual that a step could lower, and knows the pose it came from") {
  check::Random random(5);
  Scene scene(mechanism, random);
  const Robot& robot = scene.robot;
  for (int k = 0; k < 20; ++k) {
    const Pose pose = any_pose(random, 0.8);
    Parasitic rest;
    Extended q_e, expected;
    PoseRows H_x;
    CHECK(linearise(level, robot, pose, q_e, H_x, nullptr, &rest));
    Pose found = nearby(K, pose, random, 1e-3);
    Estimate exact = estimate(level, robot, scene.known, q_e, found, scene.work.data());
    CHECK(exact);
    CHECK(distance(K, found, pose) < 1e-9);
    CHECK(exact.chi2 < 1e-9);

    // Readings that no pose explains: HᵀC⁻¹(q_e - h(x̂)) = 0, C as taken where the motors say.
    for (int c = 0; c < readings(robot); ++c) q_e[c] += 3e-4 * random();
    Joint q{};
    std::copy_n(q_e.begin(), motors, q.begin());
    Pose by_motors = pose;
    CHECK(motors_pose(level, robot, q, by_motors, rest) == Status::ok);
    found = nearby(K, pose, random, 1e-3);
    const Estimate best = estimate(level, robot, scene.known, q_e, found, scene.work.data());
    CHECK(best);
    const Eigen::MatrixXd weights = reference::inverse(dense(level, scene, by_motors).C);
    const Eigen::MatrixXd H = dense(level, scene, found).H;
    CHECK(linearise(level, robot, found, expected, H_x, nullptr, &rest));
    Eigen::VectorXd residual(readings(robot));
    for (int c = 0; c < residual.size(); ++c) residual[c] = q_e[c] - expected[c];
    const Eigen::MatrixXd normal = H.transpose() * weights * H;
    const Eigen::VectorXd step = reference::solve(normal, H.transpose() * weights * residual);
    for (int i = 0; i < n; ++i)  // in units of σ
      CHECK(std::fabs(step[i]) < 1e-6 * std::sqrt(best.covariance[i][i]));
    CHECK_NEAR(best.chi2, residual.dot(weights * residual), 1e-6 * (1 + best.chi2));
  }
}

TEST("elimination keeps the squares, and leaves rows below that no pose moves") {
  check::Random random(6);
  for (int n = 2; n <= 6; ++n)
    for (int rows = n; rows <= kMaxRows; rows += 3)
      for (const int width : {1, 15, 16, 53}) {
        RowsOfPose A{};
        std::array<double, kMaxRows> e{};
        reference::Rows B(rows, width);
        Eigen::MatrixXd H(rows, n);
        Eigen::VectorXd residual(rows);
        for (int i = 0; i < rows; ++i) {
          for (int j = 0; j < n; ++j) H(i, j) = A[i][j] = random();
          for (int k = 0; k < width; ++k) B(i, k) = random();
          residual[i] = e[i] = random();
        }
        const Eigen::MatrixXd before = B;
        CHECK(eliminate(n, rows, A, B.data(), width, e));
        // What a projection on the complement of H's columns leaves.
        const Eigen::MatrixXd free = Eigen::MatrixXd::Identity(rows, rows) -
                                     H * reference::inverse(H.transpose() * H) * H.transpose();
        const Eigen::MatrixXd rest = B.bottomRows(rows - n);
        CHECK((rest.transpose() * rest - before.transpose() * free * before).norm() < 1e-9 * width);
        Eigen::VectorXd tail(rows - n);
        for (int i = n; i < rows; ++i) tail[i - n] = e[i];
        CHECK((rest.transpose() * tail - before.transpose() * free * residual).norm() <
              1e-9 * width);
        CHECK_NEAR(tail.squaredNorm(), residual.dot(free * residual), 1e-9);
        Coordinates x{};  // and the best pose for a given change of ξ: here none
        std::copy_n(e.begin(), n, x.begin());
        back_substitute(n, A, x);
        const Eigen::VectorXd best = reference::solve(H, residual);
        for (int j = 0; j < n; ++j) CHECK_NEAR(x[j], best[j], 1e-9 * (1 + best.norm()));
      }
}

TEST("rows that do not determine the pose are no pose") {
  RowsOfPose A{};
  std::array<double, kMaxRows> e{};
  double B[3] = {};
  for (int i = 0; i < 3; ++i) A[i] = {1.0 + i, 2.0 + 2 * i};
  CHECK(!eliminate(2, 3, A, B, 1, e));
  A[1][1] = NAN;
  CHECK(!eliminate(2, 3, A, B, 1, e));
}

TEST("times_root is a product with a lower triangle, whatever is above it") {
  check::Random random(7);
  for (const int p : {1, 7, 8, 9, 16, 53}) {
    reference::Rows root(p, p), B(5, p);
    for (int i = 0; i < p; ++i)
      for (int j = 0; j < p; ++j) root(i, j) = j <= i ? random() : NAN;
    for (int i = 0; i < B.size(); ++i) B.data()[i] = random();
    const Eigen::MatrixXd product = B * Eigen::MatrixXd(root.triangularView<Eigen::Lower>());
    times_root(Knowledge{p, nullptr, root.data(), {}}, 5, B.data());
    CHECK((B - product).norm() < 1e-13 * p);
    times_root(Knowledge{p, nullptr, nullptr, {}}, 5, B.data());  // no root: unit σ
    CHECK((B - product).norm() < 1e-13 * p);
  }
}

TEST_EACH(
    for_each_model,
    "a visit leaves the information of all its rows at once, those of known poses among them") {
  check::Random random(5);
  Scene scene(mechanism, random);
  std::vector<Visit> visits(15);
  for (Visit& visit : visits) visit.pose = any_pose(random);
  Coordinates at_last = to_coordinates(K, visits.back().pose);
  Joint sigma;
  sigma.fill(1e-4);
  at_last[0] = NAN;  // all coordinates but one
  visits.back().outside = {at_last.data(), sigma.data()};
  const int p = scene.known.count;
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(p, p);
  for (const Visit& visit : visits) {
    Dense at = dense(level, scene, visit.pose);
    for (int i = 0; i < at.H.rows(); ++i) {
      at.H.row(i) /= scene.known.sigma[i];
      at.B.row(i) /= scene.known.sigma[i];
    }
    if (visit.outside.x) {
      const long rows = at.H.rows();
      at.H.conservativeResize(rows + n - 1, n);
      at.B.conservativeResize(rows + n - 1, p);
      at.H.bottomRows(n - 1) = Eigen::MatrixXd::Identity(n, n).bottomRows(n - 1) / sigma[0];
      at.B.bottomRows(n - 1).setZero();
    }
    const Eigen::MatrixXd rest = reference::complement(at.H) * at.B;
    information += rest.transpose() * rest;
  }
  VisitRows all;
  CHECK(bool(rows_of_visits(level, scene.robot, scene.known, 0, visits, {}, all)));
  const Eigen::MatrixXd B = reference::dense(all.B) * scene.root,
                        found = Eigen::MatrixXd::Identity(p, p) + B.transpose() * B;
  const Eigen::MatrixXd expected = reference::inverse(information);
  CHECK((reference::inverse(found) - expected).norm() < 1e-7 * expected.norm());
}

TEST_EACH(for_each, "an estimate that cannot be leaves the guess, and says why") {
  check::Random random(8);
  Scene scene(mechanism, random);
  const Pose guess = to_pose(K, scene.robot.home);
  Extended q_e;
  CHECK(extended(Level::ideal, scene.robot, guess, q_e));
  Pose pose = guess;
  Extended lost = q_e;
  lost[1] = NAN;
  const auto status = [&](const Extended& read) {
    return estimate(Level::ideal, scene.robot, scene.known, read, pose, scene.work.data())
        .outcome.status;
  };
  CHECK(status(lost) == Status::not_finite);
  CHECK(distance(K, pose, guess) < 1e-15);
  scene.known.sigma[0] = 0;
  CHECK(status(q_e) == Status::not_finite);
  CHECK(distance(K, pose, guess) < 1e-15);
}

TEST("whole turns of a joint are nobody's geometry, those of the nacelle and lengths are") {
  Robot robot = h4().robot;
  Extended expected{}, q_e{}, residual;
  for (int k = 0; k <= static_cast<int>(SensorKind::motor_encoder); ++k) {
    Sensor& sensor = robot.sensor[0];
    sensor.kind = static_cast<SensorKind>(k);
    sensor.gain = 4;
    const bool turns = sensor.kind == SensorKind::rod_in_plane ||
                       sensor.kind == SensorKind::motor_encoder ||
                       sensor.kind == SensorKind::inclinometer;
    for (const double turn : {-2.0, -0.3, 0.0, 0.4, 1.0}) {  // of the shaft: × gain as it reads
      q_e[4] = 0.7 + 2 * std::numbers::pi * sensor.gain * turn;
      expected[4] = 0.7;
      innovation(robot, q_e, expected, residual);
      const double left = turns ? turn - std::nearbyint(turn) : turn;
      CHECK_NEAR(residual[4], 2 * std::numbers::pi * sensor.gain * left, 1e-12);
    }
  }
  for (const bool revolute : {true, false}) {
    robot.chain[2].actuator = revolute ? Actuator::revolute : Actuator::prismatic;
    q_e[2] = 2 * std::numbers::pi + 0.1;
    innovation(robot, q_e, expected, residual);
    CHECK_NEAR(residual[2], revolute ? 0.1 : 2 * std::numbers::pi + 0.1, 1e-12);
  }
}
