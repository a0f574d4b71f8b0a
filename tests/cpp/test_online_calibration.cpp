// One update of the online calibration filter.
#include "calibration/dense.hpp"
#include "estimation/linearise.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

/// A robot that differs from the drawn one within its tolerances, and a filter that does not know.
/// One sensor more than the mechanisms have in use.
class Scene {
 public:
  Robot robot, truth;

  Scene(const Mechanism& mechanism, unsigned seed, int r = 2, double off = 1.7)
      : robot(two_sensors(mechanism, r)),
        truth(robot),
        prior_(robot),
        learner_(prior_.learner(robot)),
        random_(seed) {
    const Knowledge known = learner_.knowledge();
    std::vector<double> xi(parameter_count(robot));
    CHECK(drawn_parameters(robot, xi.data()));
    for (int k = 0; k < known.count; ++k)
      xi[known.column[k]] += off * known.root[k * known.count + k] * random_();
    CHECK(set_parameters(robot, xi.data(), truth));
    learner_.settings.changes.drifts = 0;
    learner_.fresh = 0;
  }
  OnlineCalibrator& learner() { return learner_; }
  OnlineState& state() { return learner_.state; }
  int count() const { return learner_.state.count; }
  check::Random& random() { return random_; }

  /// What the true robot reads at a pose, off by at most √3 σ.
  Extended read(Level level, const Coordinates& x) {
    Extended q_e{};
    PoseRows H_x;
    Parasitic rest;
    CHECK(linearise(level, truth, to_pose(robot.mobility, x), q_e, H_x, nullptr, &rest));
    for (int c = 0; c < readings(robot); ++c)
      q_e[c] += std::sqrt(3) * learner_.state.sigma[c] * random_();
    return q_e;
  }
  /// Learns from one row at a random pose.
  Outcome row(Level level, const Mechanism& mechanism) {
    return calibrate_online(level, learner_, read(level, random_pose(mechanism, random_, 0.5)));
  }
  Eigen::VectorXd mean() const {
    Eigen::VectorXd mean(count());
    for (int k = 0; k < count(); ++k) mean(k) = learner_.state.xi[learner_.state.column[k]];
    return mean;
  }
  reference::Rows covariance() const {
    const Eigen::Map<const reference::Rows> S(learner_.state.root, count(), count());
    return S * S.transpose();
  }

 private:
  static Robot two_sensors(const Mechanism& mechanism, int r) {
    Robot robot = mechanism.robot;
    robot.r = r;
    return robot;
  }
  Prior prior_;
  OnlineCalibrator learner_;
  check::Random random_;
};

}  // namespace

TEST("the equations of a line, one after another, say what they say together") {
  check::Random random(3);
  constexpr int p = 9, r = 4;
  reference::Rows F(r, p);
  for (int i = 0; i < r; ++i)
    for (int j = 0; j < p; ++j) F(i, j) = 3 * random();
  Innovations line;
  line.r = r;
  Eigen::VectorXd y(r);
  for (int i = 0; i < r; ++i) line.y[i] = y(i) = 10 * random();
  reference::Rows sequential = F;
  decorrelate(p, sequential.data(), 0, line);
  const Eigen::MatrixXd C = F * F.transpose() + Eigen::MatrixXd::Identity(r, r);
  CHECK_NEAR(line.chi2(), y.dot(reference::inverse(C) * y), 1e-10);
  double volume = 1;
  for (int i = 0; i < r; ++i) volume *= line.total[i];
  CHECK_NEAR(volume, reference::determinant(C), 1e-9 * volume);
}

TEST_EACH(for_each_model,
          "one line is learnt as Kalman's formula has it, all of its equations together") {
  Scene scene(mechanism, 11, 2, 0.01);  // so little that nothing is of second order
  const int rows = readings(scene.robot), p = scene.count();
  const Eigen::VectorXd before = scene.mean();
  const reference::Rows P = scene.covariance();
  const Extended q_e = scene.read(level, robot.home);
  // About a ξ of linearisation, so that nothing counts as curvature.
  std::vector<double> about(parameter_count(scene.robot));
  CHECK(drawn_parameters(scene.robot, about.data()));
  scene.learner().settings.linearised = about.data();
  OnlineCalibrator& learner = scene.learner();
  CHECK(observe(level, learner, q_e));

  // Densely: x unknown with a flat prior. Linearised at x̂ less the last small step.
  Pose pose = learner.pose;
  Extended expected, residual;
  PoseRows H_x;
  reference::Rows H_xi(rows, parameter_count(scene.robot));
  Parasitic rest;
  CHECK(linearise(level, learner.robot, pose, expected, H_x, H_xi.data(), &rest));
  innovation(learner.robot, q_e, expected, residual);
  Eigen::MatrixXd A(rows, n), B(rows, p);
  Eigen::VectorXd e(rows);
  for (int c = 0; c < rows; ++c) {
    const double sigma = scene.state().sigma[c];
    e(c) = residual[c] / sigma;
    for (int j = 0; j < n; ++j) A(c, j) = H_x[c][j] / sigma;
    for (int k = 0; k < p; ++k) B(c, k) = H_xi(c, scene.state().column[k]) / sigma;
  }
  const Eigen::MatrixXd N = reference::complement(A);
  const Eigen::MatrixXd h = N * B;
  const Eigen::MatrixXd C = h * P * h.transpose() + Eigen::MatrixXd::Identity(rows - n, rows - n);
  const Eigen::MatrixXd gain = P * h.transpose() * reference::inverse(C);
  const Eigen::VectorXd step = gain * (N * e), learnt = scene.mean() - before;
  const reference::Rows posterior = P - gain * h * P;
  const reference::Rows found = scene.covariance();
  double furthest = 0;
  for (int k = 0; k < p; ++k)
    furthest = std::max(furthest, std::fabs(step(k)) / std::sqrt(P(k, k)));
  for (int k = 0; k < p; ++k) {
    CHECK_NEAR(learnt(k), step(k), 0.01 * furthest * std::sqrt(P(k, k)));
    CHECK_NEAR(found(k, k), posterior(k, k), 1e-3 * P(k, k));
  }
}

TEST_EACH(for_each_model,
          "a robot that differs within its tolerances passes the gate from its first line on") {
  Scene scene(mechanism, 12);
  for (long k = 0; k < check::sample_size(200); ++k)
    CHECK(scene.row(level, mechanism).status == Status::ok);
}

TEST_EACH(for_each_model,
          "where one reading alone is wrong, the others teach what they teach without it") {
  const auto taught = [&](bool wrong) {
    Scene scene(mechanism, 13);
    for (int k = 0; k < 60; ++k) CHECK(scene.row(level, mechanism));
    Extended q_e = scene.read(level, robot.home);
    const std::vector<double> about(scene.state().xi,
                                    scene.state().xi + parameter_count(scene.robot));
    scene.learner().settings.linearised = about.data();  // no curvature: it grows with σ
    if (wrong) q_e[n + 1] += 1e3 * scene.state().sigma[n + 1];
    if (!wrong) scene.state().sigma[n + 1] *= 1e7;
    const Outcome outcome = calibrate_online(level, scene.learner(), q_e);
    CHECK(outcome.status == (wrong ? Status::disagree : Status::ok));
    CHECK(outcome.chain == (wrong ? n + 1 : -1));
    return scene.mean();
  };
  const Eigen::VectorXd alone = taught(true), without = taught(false);
  CHECK((alone - without).cwiseAbs().maxCoeff() < 1e-8);
}

TEST_EACH(for_each_model, "a line that nothing explains teaches nothing") {
  if (motors > n) return;  // which redundant motors explain
  Scene scene(mechanism, 14, 1);
  for (int k = 0; k < 60; ++k) CHECK(scene.row(level, mechanism));
  const Eigen::VectorXd mean = scene.mean();
  const reference::Rows P = scene.covariance();
  Extended q_e = scene.read(level, robot.home);
  q_e[n] += 1000 * scene.state().sigma[n];
  const Outcome outcome = calibrate_online(level, scene.learner(), q_e);
  CHECK(outcome.status == Status::disagree && outcome.chain == -1);
  CHECK(scene.mean() == mean && scene.covariance() == P);
  for (int cycle = 0; cycle < 100; ++cycle) CHECK(calibrate_online(level, scene.learner(), q_e));
  CHECK(!scene.state().test.stopped);  // at rest a bad line is no news
}

TEST_EACH(for_each_model,
          "readings that keep disagreeing stop it within ten lines, at what was last good") {
  Scene scene(mechanism, 15);
  const auto line = [&] { return scene.read(level, random_pose(mechanism, scene.random(), 0.5)); };
  std::vector<Eigen::VectorXd> means;
  for (int k = 0; k < 60; ++k) {
    CHECK(calibrate_online(level, scene.learner(), line()));
    means.push_back(scene.mean());
  }
  int lines = 0;
  Status status = Status::ok;
  for (; lines < 20 && status != Status::stopped; ++lines) {
    Extended q_e = line();
    q_e[n + 1] += 1000 * scene.state().sigma[n + 1];
    status = calibrate_online(level, scene.learner(), q_e).status;
  }
  CHECK(status == Status::stopped && lines <= 10);
  CHECK(scene.state().test.suspect == -1 || scene.state().test.suspect == n + 1);
  const Eigen::VectorXd kept = scene.mean();
  bool earlier = false;
  for (std::size_t k = means.size() - 10; k < means.size(); ++k) earlier |= means[k] == kept;
  CHECK(earlier);
  CHECK(calibrate_online(level, scene.learner(), line()).status == Status::stopped);
  CHECK(scene.mean() == kept);
}

TEST("random walks take their turns, and all that each would have walked meanwhile") {
  Mechanism mechanism = h4();
  Scene scene(mechanism, 16, 0);  // no sensor: nothing is learnt, all only drifts
  const int p = scene.count(), walks = 3, rounds = 20;
  reference::Rows drift(walks, p);
  for (int w = 0; w < walks; ++w)
    for (int k = 0; k < p; ++k) drift(w, k) = 1e-5 * scene.random()();
  scene.learner().settings.changes.drifts = walks;
  scene.learner().settings.changes.drift = drift.data();
  const reference::Rows before = scene.covariance();
  for (int k = 0; k < walks * rounds; ++k)
    CHECK(calibrate_online(scene.learner(), scene.read(Level::ideal, mechanism.robot.home)));
  const reference::Rows expected = before + walks * rounds * drift.transpose() * drift;
  CHECK((scene.covariance() - expected).cwiseAbs().maxCoeff() < 1e-12 * expected.maxCoeff());
}
