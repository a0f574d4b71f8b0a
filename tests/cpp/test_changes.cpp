// Changes of a machine at work: which are recognised and followed, and how the robot in use moves.
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {
/// A machine with two sensors, and a calibrator that follows it.
class Scene {
 public:
  Scene(const Mechanism& mechanism, unsigned seed, Level level = Level::ideal)
      : truth(two_sensors(mechanism.robot)),
        mechanism_(mechanism),
        drawn_(truth),
        prior_(drawn_),
        learner(prior_.follower(drawn_)),
        random(seed),
        level_(level) {
    std::vector<double> xi(parameter_count(drawn_));
    CHECK(drawn_parameters(drawn_, xi.data()) && set_parameters(drawn_, xi.data(), truth));
    learner.robot = truth;
  }
  /// Homes the first motor anew.
  void home() {
    truth.chain[0].encoder_offset += truth.chain[0].actuator == Actuator::revolute ? 12e-3 : 4e-3;
  }

  /// The true machine's readings at a random pose, off by at most √3 σ.
  Extended read() {
    Extended q_e{};
    PoseRows H_x;
    Parasitic rest;
    const Pose pose = to_pose(truth.mobility, random_pose_at());
    CHECK(linearise(level_, truth, pose, q_e, H_x, nullptr, &rest));
    for (int c = 0; c < readings(truth); ++c)
      q_e[c] += std::sqrt(3) * learner.state.sigma[c] * random();
    return q_e;
  }
  Outcome learn(const Extended& q_e) { return calibrate_online(level_, learner, q_e); }
  /// Learns `rows` rows, and what waits after them.
  void work(int rows) {
    for (int k = 0; k < rows; ++k) static_cast<void>(learn(read()));
    const Extended last = learner.last;
    while (replaying(learner)) static_cast<void>(learn(last));
  }
  const Window& window() const { return *learner.state.window; }
  const Recognised& news() const { return window().news[0]; }

  Robot truth;

 private:
  static Robot two_sensors(Robot robot) {
    robot.r = 2;
    return robot;
  }
  Coordinates random_pose_at() { return random_pose(mechanism_, random, 0.5); }
  const Mechanism& mechanism_;
  Robot drawn_;
  Prior prior_;

 public:
  OnlineCalibrator learner;
  check::Random random;

 private:
  Level level_;
};
}  // namespace

TEST_EACH(for_each_model,
          "a motor that is homed anew is recognised, and no machine that is as before") {
  Scene same(mechanism, 81, level);
  same.work(200);
  CHECK(same.window().recognised == 0 && !same.learner.state.test.stopped);

  Scene scene(mechanism, 82, level);
  if (motors > n) return;  // whose redundant motors tell it from the first row
  scene.home();
  scene.work(150);
  CHECK(!scene.learner.state.test.stopped);
  CHECK(scene.window().recognised >= 1 && scene.news().kind == ChangeKind::part);
  const long left_out = scene.learner.left_out;
  scene.work(40);  // its rows agree now
  CHECK(scene.learner.left_out == left_out);
}

TEST_EACH(for_each, "rows of a reading that strays are left out") {
  Scene scene(mechanism, 83);
  scene.work(60);
  const std::vector<double> before(scene.learner.state.xi,
                                   scene.learner.state.xi + parameter_count(scene.truth));
  const Scene* const of = &scene;
  for (int k = 0; k < 110; ++k) {
    Extended q_e = scene.read();
    q_e[n + 1] = k % 2 ? q_e[n + 1] + 0.3 : q_e[n + 1] - 0.2;
    static_cast<void>(scene.learn(q_e));
  }
  while (replaying(scene.learner)) static_cast<void>(scene.learn(scene.learner.last));
  for (std::size_t k = 0; k < before.size(); ++k)
    CHECK_NEAR(of->learner.state.xi[k], before[k], 1e-3);
}

TEST_EACH(for_each, "the robot in use approaches what is learnt by a tenth of a count a cycle") {
  Scene scene(mechanism, 84);
  scene.home();
  double most = 0, moved = 0;
  for (int k = 0; k < 120; ++k) {
    const Robot before = scene.learner.robot;
    static_cast<void>(scene.learn(scene.read()));
    const Coordinates x = to_coordinates(robot.mobility, scene.learner.pose);
    Joint was{}, is{};
    if (!ikm(Level::ideal, before, x, was) || !ikm(Level::ideal, scene.learner.robot, x, is))
      continue;
    for (int i = 0; i < motors; ++i) {
      most = std::max(most, std::fabs(is[i] - was[i]));
      moved += std::fabs(is[i] - was[i]);
    }
  }
  CHECK(most < 1.1 * kJump * scene.learner.state.sigma[0]);
  CHECK(moved > 0);
}

TEST("the reported change is the likeliest of the kind that is decided") {
  // Of three alike parts each is less likely than the fault of one reading, but not all together.
  constexpr int kSets = 3, kReadings = 2;
  const std::int32_t end[]{1, 2, 3};
  const double odds[]{0, 0, 0}, step[kSets]{};
  const ChangeSettings changes{kSets, kSets, 0, -1, step, end, odds};
  constexpr int kSteps = kSets + 2 * kReadings, kWidest = 2;
  std::vector<double> z(kSteps, 0), product(kSteps * kWidest, 0), scratch(64), share(kSets, 0);
  Window window;
  window.widest = kWidest, window.z = z.data(), window.product = product.data();
  window.scratch = scratch.data(), window.share = share.data();
  window.sigma.fill(1e-5);
  for (Extended& noisy : window.noisy) noisy.fill(-20);
  const auto decided = [&] {
    Extended sigma = window.sigma;
    return decide(changes, kReadings, window, sigma);
  };
  // log odds z²/2 with S = 0: 8 of each part, 8.5 of the second reading's fault
  for (int k = 0; k < kSets; ++k) z[k] = 4 + 1e-3 * (k == 2);
  z[kSets + 2] = std::sqrt(2 * (8.5 - kLogFault));
  const Recognised part = decided().likeliest;
  CHECK(part.kind == ChangeKind::part && part.which == 2);
  // The other way round: two faults together are likelier than the one part.
  z.assign(kSteps, 0);
  z[0] = std::sqrt(2 * 8.5);
  z[kSets] = std::sqrt(2 * (8 - kLogFault)), z[kSets + 2] = z[kSets] + 1e-3;
  const Recognised fault = decided().likeliest;
  CHECK(fault.kind == ChangeKind::fault && fault.which == 1);
  // Noise that is not decisive is of a reading, too.
  z.assign(kSteps, 0);
  window.noisy[2][1] = 1 - kLogNoise;
  const Finding noise = decided();
  CHECK(!noise.decisive && noise.likeliest.kind == ChangeKind::noise);
  CHECK(noise.likeliest.which == 1);
}

TEST_EACH(for_each, "a fault that goes on is reported once") {
  Scene scene(mechanism, 86);
  scene.work(60);
  const long before = scene.window().recognised;
  for (int k = 0; k < 600; ++k) {
    Extended q_e = scene.read();
    q_e[n + 1] += k % 2 ? 0.3 : -0.2;
    static_cast<void>(scene.learn(q_e));
  }
  const Window& window = scene.window();
  CHECK(window.recognised > before && window.recognised <= kNews);
  for (long k = before + 1; k < window.recognised; ++k)
    CHECK(window.news[k].kind != window.news[k - 1].kind ||
          window.news[k].which != window.news[k - 1].which);
  CHECK(scene.learner.state.test.stopped);
}

TEST_EACH(for_each, "after a roll-back in a second pass rows are linearised at the filter") {
  Scene scene(mechanism, 87);
  if (motors > n) return;
  scene.home();
  for (int k = 0; k < 150 && !scene.learner.settings.linearised; ++k)
    static_cast<void>(scene.learn(scene.read()));
  CHECK(scene.learner.settings.linearised);
  static_cast<void>(scene.learn(scene.read()));
  CHECK(roll_back(scene.learner));
  CHECK(!scene.learner.settings.linearised);
  const OnlineCalibrator& learner = scene.learner;
  CHECK(
      std::equal(learner.in_use, learner.in_use + parameter_count(scene.truth), learner.state.xi));
}

TEST("a row costs three at most, also while earlier ones are processed again") {
  const Mechanism mechanism = h4();
  Scene scene(mechanism, 85);
  scene.home();
  int most = 0;
  for (int k = 0; k < 150; ++k) {
    const int next = scene.window().next;
    static_cast<void>(scene.learn(scene.read()));
    most = std::max(most, scene.window().next - next);
    CHECK(scene.window().last <= kStored);
  }
  CHECK(most == kReplayed);
}
