// The cached gain matrix. As consistent as fresh ones anywhere,
// the same where they are fresh, and as good as they claim in between.
#include "control/fault_tolerant_control.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"

using namespace truepose;

namespace {

/// A robot and what is known of it: drawn, or learnt from lines over its box as well.
struct Scene {
  mechanisms::Mechanism mechanism;
  Robot& robot = mechanism.robot;
  const Mobility K = robot.mobility;
  mechanisms::Prior prior;
  std::vector<double> root, H_xi, B;
  CachedGain kept;

  Scene(const mechanisms::Mechanism& which, int r, int lines = 0)
      : mechanism(sensed(which, r)), prior(robot) {
    OnlineCalibrator learner = prior.learner(robot);
    check::Random random(3);
    for (int k = 0; k < lines; ++k) {
      Extended q_e;
      CHECK(extended(Level::ideal, robot, to_pose(K, mechanisms::random_pose(mechanism, random)),
                     q_e));
      CHECK(calibrate_online(learner, q_e));
    }
    H_xi.resize((dof(K) + r) * parameter_count(robot));
    B.resize((dof(K) + r) * prior.known().count);
  }
  Scene(const Scene&) = delete;

  static mechanisms::Mechanism sensed(mechanisms::Mechanism mechanism, int r) {
    mechanism.robot.r = r;
    CHECK(finish(mechanism.robot));
    return mechanism;
  }
  const Knowledge& known() { return prior.known(); }
  Weighing fresh() { return prior.weighing(); }
  Weighing keeping() { return {&prior.known(), prior.weighing().work, &kept}; }

  /// A path through the box, every coordinate at a frequency of its own.
  Coordinates along(double time, double size = 0.8) const {
    Coordinates x = robot.home;
    for (int i = 0; i < dof(K); ++i)
      x[i] += size * mechanism.box[i] * std::sin((2 + 0.7 * i) * time + i);
    return x;
  }

  /// The weighted TEJ at x, and x̂ of the law of the estimate where the robot stands beside x.
  struct Answer {
    ExtendedRows tej;
    Pose found;
  };
  Answer answer(const Coordinates& x, const Weighing& weighing, double beside = 1e-3) {
    Reference reference;
    Answer answer;
    Joint error;
    Extended q_e;
    check::Random random(9);
    CHECK(extended(Level::ideal, robot, mechanisms::nearby(K, to_pose(K, x), random, beside), q_e));
    CHECK(refer(robot, Law::weighted, x, reference, 0, weighing));
    answer.tej = reference.tej;
    CHECK(refer(robot, Law::estimated, x, reference, 0, weighing));
    CHECK(motor_error(robot, Law::estimated, reference, q_e, error, answer.found, weighing));
    return answer;
  }

  /// Least squares in the robot's own C at a pose.
  ReadingCovariance C;
  PoseRows H_x;
  Fusion fusion;
  reference::Dense J{dof(K), dof(K)};
  void look(const Pose& pose) {
    Extended q_e;
    CHECK(linearise(Level::ideal, robot, pose, q_e, H_x, H_xi.data()));
    CHECK(reading_covariance(robot, known(), H_xi.data(), B.data(), C));
    CHECK(fuse(robot, known(), C, H_x, fusion));
    for (int i = 0; i < dof(K); ++i)
      for (int j = 0; j < dof(K); ++j) J(i, j) = H_x[i][j];
    J = reference::inverse(J);
  }
  /// Row i of the gain that a TEJ has, less that of the fresh weights.
  Extended apart(const ExtendedRows& tej, int i) const {
    Extended row{};
    for (int c = 0; c < readings(robot); ++c) {
      row[c] = -fusion.gain[i][c];
      for (int j = 0; j < dof(K); ++j) row[c] += J(i, j) * tej[j][c];
    }
    return row;
  }
  /// By how much of its σ the coordinate that moves most moves, in the root of the mean square.
  double share(const Pose& pose, const ExtendedRows& tej) {
    look(pose);
    double most = 0;
    const int rows = readings(robot);
    for (int i = 0; i < dof(K); ++i) {
      const Extended row = apart(tej, i);
      double sum = 0;
      for (int k = 0; k < rows; ++k) {
        double entry = 0;
        for (int c = k; c < rows; ++c) entry += row[c] * known().sigma[c] * C.L[c][k];
        sum += entry * entry;
      }
      most = std::max(most, sum / fusion.covariance[i][i]);
    }
    return std::sqrt(most);
  }
};

/// Calls f(scene) for every mechanism with one sensor and with two, as drawn and after learning.
template <class F>
void for_each_scene(F&& f) {
  mechanisms::for_each_square([&](const mechanisms::Mechanism& mechanism) {
    for (const int r : {1, 2})
      for (const int lines : {0, 60}) {
        Scene scene(mechanism, r, lines);
        f(scene);
      }
  });
}

/// Largest entry of the difference of two TEJ.
double apart(int n, int rows, const ExtendedRows& a, const ExtendedRows& b) {
  double most = 0;
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < rows; ++c) most = std::max(most, std::fabs(a[i][c] - b[i][c]));
  return most;
}

}  // namespace

TEST("x̂ moves by less than a tenth of its σ for weights that are kept, on paths through the box") {
  long cycles = 0, refreshed = 0;
  for_each_scene([&](Scene& scene) {
    for (int k = 0; k < 400; ++k) {
      const Joint q = scene.kept.q;
      Reference reference;
      CHECK(
          refer(scene.robot, Law::weighted, scene.along(4e-3 * k), reference, 0, scene.keeping()));
      CHECK(scene.share(reference.closure.pose, reference.tej) < scene.kept.share);
      refreshed += q != scene.kept.q;
      ++cycles;
    }
    CHECK(scene.kept.slope > 0);  // learnt from one refresh to the next
    CHECK(scene.kept.reach != kFirstReach);
  });
  CHECK(refreshed < cycles / 4);
}

TEST("however old the weights are, the TEJ's M⁺M is 1, and readings of one pose give that pose") {
  for_each_scene([](Scene& scene) {
    const Mobility K = scene.K;
    const int n = dof(K);
    scene.answer(scene.robot.home, scene.keeping());
    scene.kept.reach = INFINITY;
    const Joint q = scene.kept.q;
    check::Random random(5);
    for (int k = 0; k < 20; ++k) {
      const Coordinates x = mechanisms::random_pose(scene.mechanism, random);
      const auto old = scene.answer(x, scene.keeping());
      CHECK(scene.kept.q == q);
      ExtendedColumns M;
      ExtendedRows unused;
      CHECK(tej(scene.robot, x, M, unused));
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          double sum = 0;
          for (int c = 0; c < readings(scene.robot); ++c) sum += old.tej[i][c] * M[c][j];
          CHECK_NEAR(sum, i == j, 1e-11);
        }
      check::Random same(9);
      const Pose true_pose = mechanisms::nearby(K, to_pose(K, x), same, 1e-3);
      CHECK(mechanisms::distance(K, old.found, true_pose) < 1e-10);
    }
  });
}

TEST("x̂ of kept weights solves their own least squares, and is near that of fresh ones") {
  for_each_scene([](Scene& scene) {
    const Mobility K = scene.K;
    const int n = dof(K);
    check::Random random(7);
    const int rows = readings(scene.robot);
    for (int k = 0; k < 60; ++k) {
      const Coordinates x = scene.along(5e-3 * k);
      Extended q_e;  // of a robot beside x whose readings disagree by a few σ
      CHECK(extended(Level::ideal, scene.robot, mechanisms::nearby(K, to_pose(K, x), random, 1e-3),
                     q_e));
      for (int c = 0; c < rows; ++c) q_e[c] += 3e-5 * random();
      Reference reference;
      Joint error;
      Pose kept;
      CHECK(refer(scene.robot, Law::estimated, x, reference, 0, scene.keeping()));
      CHECK(motor_error(scene.robot, Law::estimated, reference, q_e, error, kept, scene.keeping()));
      scene.look(kept);  // weights of that pose
      Expected fresh{kept, {}, {}};
      Parasitic rest;
      CHECK(linearise(Level::ideal, scene.robot, kept, fresh.q_e, fresh.H_x, nullptr));
      CHECK(search(Level::ideal, scene.robot, scene.known(), scene.C, q_e, fresh, rest, 0,
                   kEstimateIterations));
      // The gain of the weights that are kept, at x̂, finds no error in what is left.
      CachedFusion at;
      Extended expected, residual{};
      Coordinates step;
      PoseRows H_x;
      CHECK(linearise(Level::ideal, scene.robot, kept, expected, H_x, nullptr));
      CHECK(at.set_jacobians(scene.robot, H_x) && at.weigh(scene.robot, scene.known(), scene.kept));
      innovation(scene.robot, q_e, expected, residual);
      const double chi2 = at.step(scene.robot, residual, step);
      const Coordinates moved = difference(K, kept, fresh.pose);
      for (int i = 0; i < n; ++i) {
        const double sigma = std::sqrt(at.variance[i]);
        CHECK(std::fabs(step[i]) < 1e-3 * sigma);
        CHECK(std::fabs(moved[i]) < scene.kept.share * sigma * std::sqrt(chi2 + 0.1));
      }
    }
  });
}

TEST("another geometry, other knowledge, other noise: the weights follow in the same cycle") {
  for_each_scene([](Scene& scene) {
    const int n = dof(scene.K);
    const Coordinates x = scene.along(0.3);
    const int rows = readings(scene.robot);
    const auto as_before = scene.answer(x, scene.keeping()).tej;
    const auto follows = [&](const char* what, bool moves) {
      check::state().scene = std::string(scene.mechanism.name) + ": " + what;
      const auto fresh = scene.answer(x, scene.fresh()).tej;
      CHECK(apart(n, rows, scene.answer(x, scene.keeping()).tej, fresh) < 1e-8);
      CHECK(!moves || apart(n, rows, fresh, as_before) > 1e-7);
    };
    Knowledge& known = scene.prior.known();
    follows("nothing", false);
    known.sigma[0] *= kDisbelieved;
    follows("a motor that is not believed", true);
    known.sigma[0] /= kDisbelieved;
    known.sigma[n] *= kDisbelieved;
    follows("a sensor that is not believed", true);
    known.sigma[n] /= kDisbelieved;
    const double* root = known.root;
    std::vector<double> other(root, root + known.count * known.count);
    for (int k = 0; k < known.count; k += 3) other[k * known.count + k] *= 3;
    known.root = other.data();
    follows("another prior", true);
    other.assign(root, root + known.count * known.count);
    follows("the old one, in the same place", false);
    for (const auto part : {&Chain::rod, &Chain::encoder_offset}) {
      scene.robot.chain[0].*part += 2e-3;
      CHECK(finish(scene.robot));
      follows("a chain's parameter", false);
    }
    scene.robot.sensor[0].origin.x() += 2e-2;
    CHECK(finish(scene.robot));
    follows("where a sensor stands", false);
    known.root = root;
  });
}

TEST("weights that are no weights are refused, and nothing of them is kept") {
  Scene scene(mechanisms::h4(), 1);
  const Coordinates x = scene.robot.home;
  scene.prior.known().sigma[4] = 0;
  Reference reference;
  CHECK(refer(scene.robot, Law::weighted, x, reference, 0, scene.keeping()).status ==
        Status::not_finite);
  CHECK(scene.kept.of == 0);
  scene.prior.known().sigma[4] = 1e-5;
  CHECK(refer(scene.robot, Law::weighted, x, reference, 0, scene.keeping()));
}
