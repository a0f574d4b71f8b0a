// Calibration: the optimum, its stated σ, and robust losses.
#include "truepose/offline/calibrate.hpp"

#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

constexpr Mobility K = Mobility::planar_translation;
constexpr int n = kDof<K>;

/// A five-bar with two telemeters that differs from its drawing, and a log of it.
class Scene {
 public:
  Robot robot, truth;
  Knowledge known;
  std::vector<double> mean, q_e, measured, measured_sigma;
  std::vector<Joint> x;
  CalibrationSettings settings;
  Registration registration;

  explicit Scene(int lines, int r = 2, bool in_unknown_frame = false)
      : robot(five_bar().robot), prior_((robot.r = r, robot)) {
    const Knowledge of_robot = prior_.known();
    column_.assign(of_robot.column, of_robot.column + of_robot.count);
    if (in_unknown_frame) {
      settings.registration = of_robot.count;
      column_.insert(column_.end(), kRegistration, -1);
    }
    const int p = static_cast<int>(column_.size());
    root = RowMatrix::Zero(p, p);
    for (int k = 0; k < of_robot.count; ++k) {
      root(k, k) = 3e-4 * (1 + k % 3);
      if (k > 0) root(k, k - 1) = 1e-4 * random_();
    }
    if (in_unknown_frame)
      for (const int k : {0, 1, 5}) root(of_robot.count + k, of_robot.count + k) = k < 5 ? 10 : 2;
    known = {p, column_.data(), root.data(), {}};
    for (double& sigma : known.sigma) sigma = 1e-5 * (2 + random_());

    mean.resize(parameter_count(robot));
    CHECK(drawn_parameters(robot, mean.data()));
    std::vector<double> true_xi = mean;
    for (int k = 0; k < of_robot.count; ++k) true_xi[column_[k]] += 1.5 * root(k, k) * random_();
    truth = robot;
    CHECK(set_parameters(robot, true_xi.data(), truth));
    const Mechanism mechanism = five_bar();
    for (int k = 0; k < lines; ++k) {
      x.push_back(random_pose(mechanism, random_));
      Extended read{};
      CHECK(extended<K>(truth, to_pose<K>(x.back()), read));
      for (int c = 0; c < readings(); ++c)
        q_e.push_back(read[c] + std::sqrt(3) * known.sigma[c] * random_());
    }
  }
  int readings() const { return n + robot.r; }
  int lines() const { return static_cast<int>(q_e.size()) / readings(); }
  double* line(int k) { return q_e.data() + k * readings(); }

  /// What a tracker measures that sees the base so.
  void measure(const Registration& by) {
    for (const Joint& at : x) {
      const Seen seen_there = seen(K, by, to_pose<K>(at));
      for (int i = 0; i < n; ++i) {
        measured_sigma.push_back(2e-5 * (1 + i));
        measured.push_back(seen_there.p[i] + measured_sigma.back() * random_());
      }
    }
  }
  CalibrationResult calibrate() const {
    ReadingLog log;
    log.count = lines(), log.q_e = q_e.data(), log.registration = registration;
    if (!measured.empty())
      log.measured = measured.data(), log.measured_sigma = measured_sigma.data();
    const Kernels model = kernels<K, IdealModel>();
    return Calibrator(robot, model, known, mean, log, settings).run();
  }
  void leave_out(int k) {
    q_e.erase(q_e.begin() + k * readings(), q_e.begin() + (k + 1) * readings());
  }

  RowMatrix root;

 private:
  check::Random random_{91};
  Prior prior_;
  std::vector<int> column_;
};

/// Largest difference of two calibrations' parameters, in units of the first one's σ.
double apart(const Scene& scene, const CalibrationResult& a, const CalibrationResult& b) {
  double most = 0;
  for (int k = 0; k < scene.known.count; ++k) {
    const int column = scene.known.column[k];
    most = std::max(most, std::fabs(a.xi[column] - b.xi[column]) / std::sqrt(a.covariance(k, k)));
  }
  return most;
}

}  // namespace

TEST("a calibration ends where the cost is level in every parameter and every pose") {
  Scene scene(12);
  const CalibrationResult result = scene.calibrate();
  CHECK(result.outcome);
  const int rows = scene.readings(), p = scene.known.count;
  Robot fitted = scene.robot;
  CHECK(set_parameters(scene.robot, result.xi.data(), fitted));
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(p, p);
  Eigen::VectorXd pull = -result.u, size = Eigen::VectorXd::Ones(p);
  double cost = result.u.squaredNorm();
  for (int k = 0; k < scene.lines(); ++k) {
    Extended q_e{}, expected, residual;
    std::copy_n(scene.line(k), rows, q_e.begin());
    Matrix<kMaxReadings, n> H_x;
    RowMatrix H_xi(rows, parameter_count(fitted));
    CHECK(linearise<K>(fitted, result.pose[k], expected, H_x, H_xi.data()));
    innovation(fitted, q_e, expected, residual);
    Eigen::MatrixXd A(rows, n), B(rows, p);
    Eigen::VectorXd e(rows);
    for (int c = 0; c < rows; ++c) {
      const double sigma = scene.known.sigma[c];
      e[c] = residual[c] / sigma;
      for (int j = 0; j < n; ++j) A(c, j) = H_x[c][j] / sigma;
      for (int i = 0; i < p; ++i) B(c, i) = H_xi(c, scene.known.column[i]) / sigma;
    }
    B *= scene.root;
    const Eigen::VectorXd by_pose = A.transpose() * e;
    CHECK(by_pose.norm() < 1e-3 * A.norm());
    const Eigen::MatrixXd left = B - A * reference::solve(A, B);
    information += B.transpose() * left;
    pull += left.transpose() * e;
    size += left.cwiseAbs().transpose() * e.cwiseAbs();
    cost += e.squaredNorm();
    CHECK_NEAR(result.chi2[k], e.squaredNorm(), 1e-5);
    CHECK(result.redundancy[k] == 2 && result.weight[k] == 1);
  }
  for (int k = 0; k < p; ++k) CHECK_NEAR(pull[k], 0, 1e-5 * size[k]);
  CHECK_NEAR(result.cost, cost, 1e-5 * cost);
  const Eigen::MatrixXd covariance =
      scene.root * reference::inverse(information) * scene.root.transpose();
  CHECK((result.covariance - covariance).norm() < 1e-7 * covariance.norm());
}

TEST("a line whose sensors were not read teaches nothing, one without a motor is left out") {
  Scene scene(12), without(12);
  for (const int k : {7, 3}) without.leave_out(k);
  scene.line(7)[n] = scene.line(7)[n + 1] = NAN;
  scene.line(3)[0] = NAN;
  const CalibrationResult result = scene.calibrate(), other = without.calibrate();
  CHECK(result.outcome && other.outcome);
  CHECK(apart(scene, result, other) < 1e-4);
  CHECK(result.status[7] == Status::ok && result.weight[7] == 1);
  CHECK(result.status[3] != Status::ok && result.weight[3] == 0 && std::isnan(result.chi2[3]));
  CHECK(result.redundancy[7] == 0 && result.redundancy[3] == 0 && result.redundancy[0] == 2);
}

TEST("under a robust loss a gross error costs its own line and no other") {
  for (const Loss loss : {Loss::student, Loss::huber}) {
    Scene scene(25), without(25);
    scene.settings.loss = without.settings.loss = loss;
    scene.settings.tuning = without.settings.tuning = loss == Loss::student ? 4 : 1;
    without.leave_out(9);
    scene.line(9)[n] += 0.02;
    const CalibrationResult result = scene.calibrate(), other = without.calibrate();
    CHECK(result.outcome && other.outcome);
    for (int k = 0; k < scene.lines(); ++k) CHECK((result.weight[k] < kOutlier) == (k == 9));
    CHECK(apart(scene, result, other) < 0.02);
    CHECK_NEAR(result.covariance.trace(), other.covariance.trace(),
               1e-3 * other.covariance.trace());
    scene.settings.loss = Loss::squares;  // which it would have misled
    CHECK(apart(scene, scene.calibrate(), other) > 1);
  }
}

TEST("a tracker in a frame of its own is registered while the geometry is learnt") {
  Scene scene(20, 0, true);
  Registration by;
  by.base = {Vec3(0.7, -1.2, 0), rotation_z(2.5)};
  scene.measure(by);
  const CalibrationResult result = scene.calibrate();
  CHECK(result.outcome);
  const int first = scene.settings.registration;
  const double turn = log_so3(result.registration.base.R * by.base.R.transpose()).z();
  CHECK(std::fabs(turn) < 4 * std::sqrt(result.covariance(first + 5, first + 5)));
  CHECK(result.covariance(first + 5, first + 5) < 1e-4);
  // The robot's own frame is part of its geometry: the base is known as well as the motors' places.
  CHECK((result.registration.base.t - by.base.t).norm() < 5e-3);
  Robot fitted = scene.robot;
  CHECK(set_parameters(scene.robot, result.xi.data(), fitted));
  for (int k = 0; k < scene.lines(); ++k) {
    CHECK(result.redundancy[k] == n);
    CHECK(result.chi2[k] < 30);
  }
}

TEST("a search says that it has not converged, and can be ended from outside") {
  Scene scene(8);
  scene.settings.iterations = 1;
  CHECK(scene.calibrate().outcome.status == Status::not_converged);
  int polled = 0;
  scene.settings.poll = [&] {
    if (++polled == 5) throw polled;
  };
  bool ended = false;
  try {
    scene.calibrate();
  } catch (int) {
    ended = true;
  }
  CHECK(ended);
}

TEST("a log of which no line fits the robot is no calibration") {
  Scene scene(3);
  for (int k = 0; k < 3; ++k) scene.line(k)[0] = NAN;
  CHECK(scene.calibrate().outcome.status == Status::unreachable);
}
