// The online calibrator: new rows, and its result after them.
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {

/// A robot that is not as drawn, and a controller that learns it.
class Scene {
 public:
  explicit Scene(const Mechanism& mechanism)
      : truth(mechanism.robot), prior_(mechanism.robot), learner(prior_.learner(mechanism.robot)) {
    for (int i = 0; i < truth.motors; ++i) truth.chain[i].rod += 1e-4 * (i - 1);
    learner.settings.changes.drifts = 0;
  }
  /// The true robot's readings at a pose; the first motor's `more` further.
  Extended read(const Coordinates& x, double more = 0) const {
    Extended q_e{};
    CHECK(extended(Level::ideal, truth, to_pose(truth.mobility, x), q_e));
    q_e[0] += more;
    return q_e;
  }
  Outcome learn(const Extended& q_e) { return truepose::calibrate_online(learner, q_e); }
  /// What readings of the last line have moved by so many σ, and so are news or not.
  double sigma() const { return learner.state.sigma[0]; }

  Robot truth;

 private:
  Prior prior_;

 public:
  OnlineCalibrator learner;
};

}  // namespace

TEST_EACH(for_each, "a line counts where a reading has moved since the last one that counted") {
  Scene scene(mechanism);
  const Extended first = scene.read(robot.home);
  CHECK(scene.learn(first));
  for (int cycle = 0; cycle < 5; ++cycle) CHECK(scene.learn(first));
  CHECK(scene.learner.lines == 1);  // at rest nothing is news
  const double fresh = scene.learner.fresh * scene.sigma();
  // One motor's reading alone moves: the others may contradict it, and the line is left out.
  const auto counted = [&] { return scene.learner.lines + scene.learner.left_out; };
  CHECK(scene.learn(scene.read(robot.home, 0.9 * fresh)));
  CHECK(scene.learner.lines == 1);
  CHECK(scene.learn(scene.read(robot.home, 1.1 * fresh)));
  CHECK(counted() == 2);
  // Slow motion adds up: against the line that counted, not against the last cycle's.
  for (int cycle = 1; cycle <= 10; ++cycle)
    CHECK(scene.learn(scene.read(robot.home, (1.1 + 0.3 * cycle) * fresh)));
  CHECK(counted() == 2 + 2);
}

TEST_EACH(for_each, "what is learnt is what the controller believes in the same cycle") {
  Scene scene(mechanism);
  check::Random random(71);
  for (int k = 0; k < 30; ++k) {
    CHECK(scene.learn(scene.read(any_x(random, 0.5))));
    std::vector<double> believed(parameter_count(robot));
    CHECK(drawn_parameters(scene.learner.robot, believed.data()));
    const OnlineState& state = scene.learner.state;
    bool same = true;
    for (int i = 0; i < n; ++i) {
      const int rod = chain_column(i) + static_cast<int>(ChainParameter::rod);
      same = same && believed[rod] == state.xi[rod];
    }
    CHECK(same);
  }
  CHECK(scene.learner.lines == 30);
}

TEST("the outcome says that a line is left out, for as long as the robot stands there") {
  int left_out = 0;
  for_each([&](const Mechanism& mechanism) {
    Scene scene(mechanism);
    CHECK(scene.learn(scene.read(mechanism.robot.home)).status == Status::ok);
    // One motor's reading alone moves. (An H4's θ at home does not see it: that line is learnt.)
    const Extended moved = scene.read(mechanism.robot.home, 300 * scene.sigma());
    const Outcome said = scene.learn(moved);
    const bool learnt = said.status == Status::ok;
    left_out += !learnt;
    for (int cycle = 0; cycle < 3; ++cycle) {
      const Outcome again = scene.learn(moved);
      CHECK(again.status == said.status && again.chain == said.chain);
      CHECK(scene.learner.lines == 1 + learnt && scene.learner.left_out == !learnt);
    }
    check::Random random(72);
    CHECK(scene.learn(scene.read(random_pose(mechanism, random, 0.5))).status == Status::ok);
    CHECK(scene.learner.lines == 2 + learnt);
  });
  CHECK(left_out > 0);
}

TEST("a robot understood rod by rod is learnt rod by rod") {
  Mechanism mechanism = h4();
  mechanism.robot.level = Level::full;
  mechanism.robot.r = 2;
  CHECK(mechanism.robot.rod_by_rod());
  Scene scene(mechanism);
  scene.truth.chain[1].rod_difference = 1e-3;  // which the ideal level does not see
  Extended q_e{};
  PoseRows H_x;
  const Pose pose = to_pose(Mobility::schoenflies, mechanism.robot.home);
  CHECK(linearise(Level::full, scene.truth, pose, q_e, H_x, nullptr));
  Scene ideal(mechanism);
  const Outcome full = scene.learn(q_e), other = calibrate_online(Level::ideal, ideal.learner, q_e);
  CHECK(full && other);
  CHECK(scene.learner.robot.chain[1].rod != ideal.learner.robot.chain[1].rod);
  Scene again(mechanism);
  CHECK(calibrate_online(Level::full, again.learner, q_e));
  CHECK(scene.learner.robot.chain[1].rod == again.learner.robot.chain[1].rod);
}
