// Calibration: the optimum, its stated σ, and robust losses.
#include "calibration/calibrate.hpp"

#include "mechanisms.hpp"
#include "reference.hpp"

using namespace mechanisms;

namespace {

/// A robot with two telemeters that differs from its drawing, and a log of it.
class SceneOf {
 public:
  Robot robot, truth;
  const Mobility K = robot.mobility;
  const int n = dof(K);
  Knowledge known;
  std::vector<double> mean, q_e, measured, measured_sigma, influence;
  std::vector<Coordinates> x;
  CalibrationSettings settings;
  Registration registration;

  /// @param influences, nuisances  their numbers
  /// @param unsure  scale of the robot's prior
  SceneOf(const Mechanism& mechanism, int lines, int r, bool in_unknown_frame = false,
          int influences = 0, int nuisances = 0, double unsure = 1)
      : robot(mechanism.robot), prior_((robot.r = r, robot)) {
    settings.influences = influences, settings.nuisances = nuisances;
    const Knowledge of_robot = prior_.known();
    column_.assign(of_robot.column, of_robot.column + of_robot.count);
    if (in_unknown_frame) {
      settings.registration = of_robot.count;
      column_.insert(column_.end(), kRegistration, -1);
    }
    column_.insert(column_.end(), settings.influences, -1);
    for (int i = 0; i < settings.nuisances; ++i)
      column_.push_back(chain_column(i) + static_cast<int>(ChainParameter::tilt));
    const int p = static_cast<int>(column_.size());
    root = reference::Rows::Zero(p, p);
    for (int k = 0; k < of_robot.count; ++k) {
      root(k, k) = unsure * 3e-4 * (1 + k % 3);
      if (k > 0) root(k, k - 1) = 1e-4 * random_();
    }
    if (in_unknown_frame)
      for (const int k : {0, 1, 5}) root(of_robot.count + k, of_robot.count + k) = k < 5 ? 10 : 2;
    for (int k = p - settings.influences - settings.nuisances; k < p; ++k)
      root(k, k) = k < p - settings.nuisances ? 2 : 5e-4;
    known = {p, column_.data(), root.data(), {}};
    for (double& sigma : known.sigma) sigma = 1e-5 * (2 + random_());

    mean.resize(parameter_count(robot));
    CHECK(drawn_parameters(robot, mean.data()));
    std::vector<double> true_xi = mean;
    for (int k = 0; k < of_robot.count; ++k) true_xi[column_[k]] += 1.5 * root(k, k) * random_();
    truth = robot;
    CHECK(set_parameters(robot, true_xi.data(), truth));
    for (int k = 0; k < lines; ++k) {
      x.push_back(random_pose(mechanism, random_));
      Extended read{};
      CHECK(extended(Level::ideal, truth, to_pose(K, x.back()), read));
      add(read);
    }
    for (int k = 0; k < lines * readings() * settings.influences; ++k) act(k);
  }
  void add(const Extended& read) {
    for (int c = 0; c < readings(); ++c)
      q_e.push_back(read[c] + std::sqrt(3) * known.sigma[c] * random_());
  }
  /// Lets an influence act on a reading: entry k of all patterns.
  void act(int k) {
    influence.push_back(3e-5 * random_());
    q_e[k / settings.influences] += influence.back() * amount(k % settings.influences);
  }
  static double amount(int influence) { return 1.5 - 2 * influence; }
  int readings() const { return n + robot.r; }
  int lines() const { return static_cast<int>(q_e.size()) / readings(); }
  double* line(int k) { return q_e.data() + k * readings(); }

  /// What a tracker measures that sees the base so.
  void measure(const Registration& by) {
    for (const Coordinates& at : x) {
      const Seen seen_there = seen(K, by, to_pose(K, at));
      for (int i = 0; i < n; ++i) {
        measured_sigma.push_back(2e-5 * (1 + i));
        measured.push_back(seen_there.p[i] + measured_sigma.back() * random_());
      }
    }
  }
  CalibrationResult calibrate() const {
    ReadingLog log;
    log.count = lines(), log.q_e = q_e.data(), log.registration = registration;
    log.influence = influence.data();
    if (!measured.empty())
      log.measured = measured.data(), log.measured_sigma = measured_sigma.data();
    return truepose::calibrate(Level::ideal, robot, known, mean, log, settings);
  }
  void leave_out(int k) {
    q_e.erase(q_e.begin() + k * readings(), q_e.begin() + (k + 1) * readings());
  }

  reference::Rows root;

 private:
  check::Random random_{91};
  Prior prior_;
  std::vector<int> column_;
};

constexpr Mobility K = Mobility::planar_translation;
constexpr int n = dof(K);

/// That of a five-bar.
struct Scene : SceneOf {
  explicit Scene(int lines, int r = 2, bool in_unknown_frame = false)
      : SceneOf(five_bar(), lines, r, in_unknown_frame) {}
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

/// Checks that a calibration ended where the cost is level in every parameter and every pose, and
/// that its covariance is that of all equations.
/// @param exact  1, or more where D is that of poses a step before
void check_level(const SceneOf& scene, const CalibrationResult& result, double exact = 1) {
  CHECK(result.outcome);
  const int rows = scene.readings(), p = scene.known.count, m = scene.settings.nuisances;
  const int given = scene.settings.influences;
  Robot fitted = scene.robot;
  CHECK(set_parameters(scene.robot, result.xi.data(), fitted));
  Knowledge axes = scene.known;
  axes.count = m;
  axes.column += p - m;
  const int freedoms = scene.n;
  const int poses = freedoms * scene.lines();
  // All equations at once: readings, prior; in all poses, then u.
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(rows * scene.lines() + p, poses + p);
  Eigen::VectorXd e = Eigen::VectorXd::Zero(J.rows());
  for (int k = 0; k < scene.lines(); ++k) {
    Extended q_e{}, expected, residual;
    std::copy_n(scene.q_e.data() + k * rows, rows, q_e.begin());
    PoseRows H_x;
    reference::Rows H_xi(2 * rows, parameter_count(fitted));
    RowMatrix D(rows, 0);
    if (paired(scene.K)) CHECK(acting(fitted, axes, result.pose[k], {}, H_xi.data(), D));
    CHECK(linearise(Level::ideal, fitted, result.pose[k], expected, H_x, H_xi.data()));
    innovation(fitted, q_e, expected, residual);
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(rows, p);
    for (int c = 0; c < rows; ++c) {
      const double sigma = scene.known.sigma[c];
      e[k * rows + c] = residual[c] / sigma;
      for (int j = 0; j < freedoms; ++j) J(k * rows + c, k * freedoms + j) = H_x[c][j] / sigma;
      for (int i = 0; i < p - m - given; ++i)
        if (scene.known.column[i] >= 0) B(c, i) = H_xi(c, scene.known.column[i]) / sigma;
      for (int j = 0; j < given; ++j)
        B(c, p - m - given + j) = scene.influence[(k * rows + c) * given + j] / sigma;
    }
    B.rightCols(m) = reference::dense(D);
    B *= scene.root;
    J.block(k * rows, poses, rows, p) = B;
    e.segment(k * rows, rows) -=
        B.rightCols(m + given) * reference::dense(result.u).tail(m + given);
    const double square = e.segment(k * rows, rows).squaredNorm();
    CHECK_NEAR(result.chi2[k], square, exact * 1e-5);
    CHECK(result.redundancy[k] == 2 && result.weight[k] == 1);
  }
  J.bottomRightCorner(p, p).setIdentity();
  e.tail(p) = -reference::dense(result.u);
  const Eigen::VectorXd pull = J.transpose() * e, size = J.cwiseAbs().transpose() * e.cwiseAbs();
  for (int k = 0; k < poses + p; ++k) CHECK_NEAR(pull[k], 0, exact * 1e-4 * (1 + size[k]));
  CHECK_NEAR(result.cost, e.squaredNorm(), exact * 1e-5 * result.cost);
  const Eigen::MatrixXd covariance =
      (scene.root * reference::inverse(J.transpose() * J).bottomRightCorner(p, p) *
       scene.root.transpose())
          .topLeftCorner(p - m, p - m);
  CHECK((reference::dense(result.covariance) - covariance).norm() <
        exact * 1e-6 * covariance.norm());
}

}  // namespace

TEST("a calibration ends where the cost is level in every parameter and every pose") {
  Scene scene(12);
  check_level(scene, scene.calibrate());
}

TEST("influences of unknown amounts are learnt with the geometry") {
  SceneOf scene(five_bar(), 30, 2, false, 2, 0);
  const CalibrationResult result = scene.calibrate();
  check_level(scene, result);
  CHECK(result.amount.size() == 2);
  for (int j = 0; j < 2; ++j) {
    const int at = scene.known.count - 2 + j;
    const double sigma = std::sqrt(result.covariance(at, at));
    CHECK(sigma < 0.5);
    CHECK(std::fabs(result.amount[j] - scene.amount(j)) < 4 * sigma);
  }
}

TEST("axes of which the ideal level does not see the errors widen what it learns") {
  const SceneOf scene(delta(), 12, 2, false, 1, 3), without(delta(), 12, 2, false, 1, 0);
  const CalibrationResult result = scene.calibrate(), other = without.calibrate();
  check_level(scene, result, 100);
  CHECK(result.covariance.rows() == other.covariance.rows());
  CHECK(reference::dense(result.covariance).trace() >
        1.01 * reference::dense(other.covariance).trace());
}

TEST("a line that is out of the drawn robot's reach counts once the learnt one reaches it") {
  SceneOf scene(five_bar(), 12, 2, false, 1, 0, 10);
  check::Random random(3);
  const int ordinary = scene.lines();
  for (int sample = 0; sample < 100000 && scene.lines() < ordinary + 3; ++sample) {
    Joint q{};
    CHECK(ikm(Level::ideal, scene.robot, scene.robot.home, q));
    for (int i = 0; i < n; ++i) q[i] += 1.5 * random();
    Pose drawn = to_pose(K, scene.robot.home), there = drawn;
    if (fkm(scene.robot, q, drawn).status == Status::ok ||
        fkm(scene.truth, q, there).status != Status::ok)
      continue;
    Extended read{};
    CHECK(extended(Level::ideal, scene.truth, there, read));
    scene.add(read);
    for (int k = scene.lines() - 1, c = 0; c < scene.readings(); ++c)
      scene.act(k * scene.readings() + c);
  }
  CHECK(scene.lines() == ordinary + 3);
  const CalibrationResult result = scene.calibrate();
  for (const Status status : result.status) CHECK(status == Status::ok);
  check_level(scene, result);
  scene.line(4)[n] += 0.1;
  const CalibrationResult other = scene.calibrate();
  CHECK(other.outcome);
  for (int k = 0; k < scene.lines(); ++k) {
    CHECK(other.status[k] == Status::ok);
    CHECK(other.weight[k] == (k != 4));
  }
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

TEST("a gross error costs its own line and no other") {
  Scene scene(25), without(25);
  without.leave_out(9);
  scene.line(9)[n] += 0.02;
  const CalibrationResult result = scene.calibrate(), other = without.calibrate();
  CHECK(result.outcome && other.outcome);
  for (int k = 0; k < scene.lines(); ++k) CHECK(result.weight[k] == (k != 9));
  CHECK(apart(scene, result, other) < 1e-4);
  CHECK_NEAR(reference::dense(result.covariance).trace(),
             reference::dense(other.covariance).trace(),
             1e-6 * reference::dense(other.covariance).trace());
  scene.settings.loss = Loss::squares;  // which it would have misled
  CHECK(apart(scene, scene.calibrate(), other) > 1);
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
