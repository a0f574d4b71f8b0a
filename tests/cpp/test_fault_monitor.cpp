// Detection of faulty readings, and their substitution.
#include <climits>

#include "control/fault_monitor.hpp"
#include "control/monitored_cycle.hpp"
#include "control/parity.hpp"
#include "control/tracker.hpp"
#include "math/chi2.hpp"
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {

constexpr double kPeriod = 1e-3;

/// A robot that moves as its model does, and a monitor over its counts.
class Scene {
 public:
  explicit Scene(const Mechanism& mechanism)
      : n(mechanism.robot.motors), robot(mechanism.robot), home_(robot.home) {
    known.sigma.fill(1e-5);
    work_.resize(static_cast<std::size_t>(estimate_work(robot, 0)));
    settings.false_alarm = 1e-9;
    settings.fastest.fill(500);
    settings.moved.fill(2e-3);
    prepare(settings);
  }
  /// Cycle k of a smooth path about home: where the robot is.
  Coordinates at(int k) const {
    Coordinates x = home_;
    for (int i = 0; i < dof(robot.mobility); ++i)
      x[i] += 0.02 * std::sin(2 * kPeriod * k * (3 + i));
    return x;
  }
  Extended read(int k) const {
    Extended q_e = readings_at(robot, at(k));
    for (int c = 0; c < readings(robot); ++c) q_e[c] = quantized(q_e[c], 3e-5);
    return q_e;
  }
  Outcome cycle(int k, const Extended& q_e) {
    const Weighing weighing{&known, work_.data()};
    Joint desired = motors_of(robot, read(std::min(k, held)));
    for (int i = 0; i < n; ++i) desired[i] += lag;
    return monitor_faults(robot, settings, weighing, desired, q_e, seen, believed);
  }
  /// Cycle k, healthy but for reading c, which is wrong by this.
  Outcome cycle(int k, int c, double wrong) {
    Extended q_e = read(k);
    right_ = q_e[c];
    q_e[c] += wrong;
    return cycle(k, q_e);
  }
  /// By how much reading c, which was wrong in the last cycle, is believed to be more than it is.
  double off(int c) const { return believed[c] - right_; }
  /// Healthy cycles 0 to k - 1.
  bool healthy(int k) {
    bool valid = true;
    for (int i = 0; i < k; ++i) valid = valid && cycle(i, read(i)).status == Status::ok;
    return valid;
  }

  int n;
  Robot robot;
  Knowledge known;
  FaultMonitorSettings settings;
  FaultMonitor seen;
  Extended believed{};
  double lag = 0;      ///< of the motors behind their setpoints
  int held = INT_MAX;  ///< cycle from which on the setpoint stays

 private:
  Coordinates home_;
  double right_ = 0;
  std::vector<double> work_;
};

}  // namespace

TEST("chi-squared is exceeded as often as asked for") {
  // Tables: P(χ²_1 > 3.841) = 0.05, P(χ²_4 > 13.277) = 0.01, P(χ²_5 > 20.515) = 0.001.
  CHECK_NEAR(chi2_beyond(0.05, 1), 3.841459, 1e-5);
  CHECK_NEAR(chi2_beyond(0.01, 4), 13.276704, 1e-5);
  CHECK_NEAR(chi2_beyond(0.001, 5), 20.515006, 1e-5);
  for (int k = 1; k <= kMaxSensors; ++k)
    for (const double p : {0.5, 1e-3, 1e-10})
      CHECK_NEAR(chi2_tail(chi2_beyond(p, k), k) / p, 1, 1e-9);
}

TEST("a tracker's gains are those of its innovations") {
  for (const double pole : {kOwnPole, kParityPole}) {
    const TrackerGains gains = tracker_gains(pole);
    // Under a constant acceleration the innovation settles at a T² times the gain.
    Tracker tracker;
    double innovation = 0;
    for (int k = 0; k < 500; ++k) {
      innovation = 0.5 * k * k - tracker.predicted(1);
      tracker.correct(1, pole, innovation);
    }
    CHECK_NEAR(innovation / gains.acceleration, 1, 1e-6);
    // Of white noise, its variance.
    check::Random random(1);
    double sum = 0;
    tracker = {};
    const int count = 200000;
    for (int k = 0; k < count; ++k) {
      const double noise = random();
      innovation = noise - tracker.predicted(1);
      tracker.correct(1, pole, innovation);
      sum += innovation * innovation;
    }
    CHECK_NEAR(3 * sum / count / gains.variance, 1, 0.03);
  }
}

TEST_EACH(for_each,
          "a parity does not depend on the pose, and has each reading's fault by its signature") {
  check::Random random(2);
  for (int pose = 0; pose < 20; ++pose) {
    const Pose at = any_pose(random);
    Extended q_e{};
    Parity parity;
    if (!extended(Level::ideal, robot, at, q_e) ||
        !parity.locate(robot, {true, nearby(K, at, random, 1e-3)}, q_e, Extended{}))
      continue;
    for (int k = 0; k < robot.r; ++k) CHECK_NEAR(parity.value[k], 0, 1e-6);  // of 1 mm the square
    for (int c = 0; c < readings(robot); ++c) {
      const double step = 1e-6;
      Extended wrong = q_e;
      wrong[c] += step;
      Parity moved;
      if (!moved.locate(robot, {true, at}, wrong, Extended{})) continue;
      const Reading g = parity.signature(robot.r, c);
      for (int k = 0; k < robot.r; ++k)
        CHECK_NEAR(moved.value[k] / step, g[k], 1e-3 * (1 + std::fabs(g[k])));
    }
  }
}

TEST_EACH(for_each, "readings of a healthy robot stay valid, and are believed as they are") {
  Scene scene(mechanism);
  for (int k = 0; k < 1000; ++k) {
    const Extended q_e = scene.read(k);
    CHECK(scene.cycle(k, q_e).status == Status::ok);
    for (int c = 0; c < readings(scene.robot); ++c) CHECK(scene.believed[c] == q_e[c]);
  }
}

TEST_EACH(for_each, "a jump, a dropout and a spike are found in their cycle, in whatever reading") {
  const int rows = readings(robot);
  for (int c = 0; c < rows; ++c)
    for (const double wrong : {0.5, static_cast<double>(NAN)}) {
      Scene scene(mechanism);
      CHECK(scene.healthy(100));
      for (int k = 100; k < 130; ++k) {
        const Outcome outcome = scene.cycle(k, c, wrong);
        CHECK(outcome.status == Status::disagree && outcome.chain == c);
        if (k < 100 + scene.settings.coast) CHECK_NEAR(scene.off(c), 0, 1e-3);
      }
      CHECK(scene.seen.reading[c].health == Health::failed);
      for (int d = 0; d < rows; ++d)
        if (d != c) CHECK(scene.seen.reading[d].health == Health::valid);
    }
}

TEST_EACH(for_each, "a motor that drops out is extrapolated with its following error") {
  Scene scene(mechanism);
  scene.lag = 2e-3;
  CHECK(scene.healthy(1000));
  CHECK(scene.cycle(1000, 0, NAN).chain == 0);
  CHECK_NEAR(scene.off(0), 0, 0.1 * scene.lag);
}

TEST_EACH(
    for_each_square,
    "a motor that returns is believed where its largest acceleration took it, but no farther") {
  constexpr double fastest = 2000;
  for (int missing = 0; missing < 5; ++missing)
    for (const double share : {0.95, 1.05}) {
      // Where a tracker predicts it that follows a constant acceleration, then nothing.
      Tracker tracker;
      int k = 0;
      const auto way = [&] {
        return 0.5 * fastest * kPeriod * kPeriod * k * k - tracker.predicted(kPeriod);
      };
      for (; k < 500; ++k) tracker.correct(kPeriod, kOwnPole, way());
      for (int left = missing; left > 0; --left, ++k) tracker.correct(kPeriod, kOwnPole, 0);
      Scene scene(mechanism);
      scene.settings.fastest = {fastest};  // of the first motor alone
      Extended q_e = scene.read(0);
      for (int i = 0; i < 100; ++i) CHECK(scene.cycle(0, q_e));
      q_e[0] = NAN;
      for (int i = 0; i < missing; ++i) CHECK(scene.cycle(0, q_e).chain == 0);
      q_e[0] = scene.read(0)[0] + share * way();
      Pose pose = to_pose(K, scene.at(0));
      CHECK(fkm(scene.robot, motors_of(scene.robot, q_e), pose).status == Status::ok);
      CHECK(extended(Level::ideal, scene.robot, pose, q_e));
      CHECK((scene.cycle(0, q_e).status == Status::ok) == (share < 1));
      CHECK((scene.seen.reading[0].symptom == Symptom::too_fast) == (share > 1));
    }
}

TEST_EACH(for_each, "a disagreement is undecided once it has lasted as many cycles as set") {
  for (const int decide : {7, 20}) {
    Scene scene(mechanism);
    scene.settings.decide = decide;
    int doubtful = 0;
    for (int k = 0; k < 100 && !scene.seen.undecided; ++k) {
      // From the start on: each reading alone explains it.
      const bool alarm = scene.cycle(k, motors, 0.01).status == Status::disagree;
      doubtful += alarm && !scene.seen.undecided;
    }
    CHECK(scene.seen.undecided);
    CHECK(doubtful == decide);
  }
}

TEST_EACH(
    for_each,
    "a geometry's error leaves as much in a tracker's innovation as the limit of a change has") {
  const Scene scene(mechanism);
  const double far = scene.settings.correlation;  // of an error sin(way/far), per cycle
  const auto left = [&](const auto& way) {
    Tracker tracker;
    double most = 0;
    for (int k = 0; k < 300; ++k) {
      const double innovation = std::sin(way(k) / far) - tracker.predicted(1);
      tracker.correct(1, kParityPole, innovation);
      if (k > 60) most = std::max(most, std::fabs(innovation));
    }
    return most;
  };
  const double speed = 1e-3, acceleration = 1e-8;
  FaultMonitor uniform, accelerated;
  uniform.motion[1] = uniform.last[1] = speed;
  accelerated.motion[0] = acceleration;
  const auto bending = [&](FaultMonitor& watch) {
    const Weighing weighing{&scene.known, nullptr};
    const Joint desired{};
    Extended q_e{};
    return fault_monitor_detail::MonitoredCycle(
               {scene.robot, scene.settings, weighing, desired, q_e, watch, q_e, nullptr})
        .bending();
  };
  CHECK_NEAR(bending(uniform) / left([=](int k) { return speed * k; }), 1, 0.01);
  CHECK_NEAR(bending(accelerated) / left([=](int k) { return 0.5 * acceleration * k * k; }), 1,
             0.01);
}

TEST_EACH(
    for_each,
    "fast motion over an unknown geometry is no jump, and in slow motion a small jump is found") {
  Scene fast(mechanism), slow(mechanism);
  Prior prior(robot);
  prior.known().sigma.fill(1e-7);
  Robot truth = robot;
  for (int i = 0; i < truth.motors; ++i) truth.chain[i].encoder_offset += 2e-4 * (1 + i % 3);
  const auto cycle = [&](Scene& scene, double rate, int k, double jump) {
    Coordinates x = truth.home;
    for (int i = 0; i < n; ++i) x[i] += 0.02 * std::sin(rate * kPeriod * k * (3 + i));
    Extended q_e = readings_at(truth, x), desired = readings_at(scene.robot, x);
    q_e[n] += jump;
    return monitor_faults(scene.robot, scene.settings, prior.weighing(),
                          motors_of(scene.robot, desired), q_e, scene.seen, scene.believed);
  };
  for (int k = 0; k < 1000; ++k) CHECK(cycle(fast, 10, k, 0).status == Status::ok);
  for (int k = 0; k < 500; ++k) CHECK(cycle(slow, 0.3, k, 0).status == Status::ok);
  CHECK(cycle(slow, 0.3, 500, 5e-6).status == Status::disagree);  // a hundredth of the geometry's
}

TEST_EACH(for_each, "a step of one reading names no other, and leaves it among the suspects") {
  for (int c = 0; c < readings(robot); ++c)
    for (const double step : {2e-4, 5e-4, 2e-3}) {
      Scene scene(mechanism);
      CHECK(scene.healthy(100));
      for (int k = 100; k < 160; ++k) {
        static_cast<void>(scene.cycle(k, c, step));
        for (int d = 0; d < readings(robot); ++d)
          CHECK(d == c || scene.seen.reading[d].health != Health::failed);
        const bool failed = scene.seen.reading[c].health == Health::failed;
        CHECK(failed || !scene.seen.doubted || scene.seen.doubted & bit(c));
      }
    }
}

TEST_EACH(for_each,
          "a motor that is lost is taken to be where it is asked to be until it is restored") {
  Scene scene(mechanism);
  CHECK(scene.healthy(100));
  scene.settings.replaceable = 1e-12;
  for (int k = 100; k < 300; ++k) {
    if (k == 200) scene.settings.replaceable = 1e9;  // by now something could stand for it
    CHECK(scene.cycle(k, 0, NAN).chain == 0);
    if (k < 100 + scene.settings.coast) continue;
    CHECK(scene.seen.lost == 1);
    CHECK(scene.off(0) == 0);
  }
  acknowledge(scene.seen, 0);
  CHECK(scene.cycle(300, scene.read(300)).status == Status::ok);
  CHECK(scene.seen.lost == 0);
}

TEST_EACH(for_each, "a monitor begins with the first readings that have a pose") {
  for (int c = 0; c < motors; ++c) {
    Scene scene(mechanism);
    for (int k = 0; k < 10; ++k) {
      const Outcome outcome = scene.cycle(k, c, NAN);
      CHECK(outcome.status == Status::not_finite && outcome.chain == c);
    }
    for (int k = 10; k < 150; ++k) CHECK(scene.cycle(k, scene.read(k)).status == Status::ok);
  }
}

TEST_EACH(for_each,
          "what stands for a sensor that is gone, or never said anything, is what the motors say") {
  for (int c = robot.motors; c < readings(robot); ++c)
    for (const auto& [nothing, begin] : {std::pair<double, int>{NAN, 100}, {NAN, 0}, {1e308, 0}}) {
      Scene scene(mechanism);
      CHECK(scene.healthy(begin));
      for (int k = begin; k < begin + 200; ++k) {
        CHECK(scene.cycle(k, c, nothing).chain == c);
        CHECK_NEAR(scene.off(c), 0, 5e-3);
      }
      CHECK(scene.seen.reading[c].symptom == Symptom::missing);
    }
}

TEST_EACH(for_each, "whole turns that an encoder loses are nothing that has moved") {
  for (int c = 0; c < readings(robot); ++c) {
    const double turn = 2 * std::numbers::pi;
    if (std::fabs(within_turn(robot, c, turn)) > 1) continue;  // of a slide: a jump
    Scene scene(mechanism);
    CHECK(scene.healthy(100));
    for (int k = 100; k < 200; ++k) {
      CHECK(scene.cycle(k, c, -turn).status == Status::ok);
      CHECK_NEAR(scene.off(c), 0, 1e-12);
    }
  }
}

TEST_EACH(for_each, "spikes of long ago are not held against a reading when another is restored") {
  Scene scene(mechanism);
  CHECK(scene.healthy(100));
  for (int k = 100; k < 1700; ++k) {
    if (k == 1400) acknowledge(scene.seen, 1);
    static_cast<void>(scene.cycle(k, 0, k == 100 || k == 200 || k == 1650 ? 0.3 : 0));
    CHECK(scene.seen.reading[0].health != Health::failed);
  }
}

TEST("what the law sees changes in the cycle in which something else stands for a reading") {
  long holds = 0;
  for_each([&](const Mechanism& mechanism) {
    for (int c = 0; c < readings(mechanism.robot); ++c) {
      Scene scene(mechanism);
      CHECK(scene.healthy(100));
      const double still = scene.read(100)[c];
      int changes = 0;
      bool stood = false, undecided = false;
      for (int k = 100; k < 400; ++k) {
        Extended q_e = scene.read(k);
        if (k < 300) q_e[c] = still;
        if (k == 300) acknowledge(scene.seen, c);
        const std::uint32_t held = scene.seen.held;
        static_cast<void>(scene.cycle(k, q_e));
        const bool released =
            (held & ~scene.seen.held) != 0;  // a doubted motor, by its own reading
        const bool stands = scene.seen.without & bit(c) && scene.believed[c] != q_e[c];
        CHECK(scene.seen.changed == (stands != stood || released));
        changes += stands != stood;
        undecided = undecided || scene.seen.undecided;
        stood = stands;
        // Where a motor is one of several that may be wrong, its setpoint stands for it.
        const std::uint32_t doubted = scene.seen.doubted;
        const bool several = doubted & bit(c) && doubted & (doubted - 1);
        if (c >= mechanism.robot.motors || !several || undecided ||
            scene.seen.reading[c].extrapolated.cycles > 0)
          continue;
        if (scene.believed[c] == q_e[c]) continue;
        CHECK(scene.seen.held & bit(c));
        ++holds;
      }
      CHECK(changes == 2 || undecided);  // there and back
    }
  });
  CHECK(holds > 0);
}

TEST_EACH(for_each, "where a motor has failed as well, a sensor that has does not drift away") {
  Scene scene(mechanism);
  CHECK(scene.healthy(100));
  for (int k = 100; k < 1100; ++k) {
    const Extended right = scene.read(k);
    Extended q_e = right;
    q_e[0] = q_e[motors] = NAN;
    static_cast<void>(scene.cycle(k, q_e));
    CHECK_NEAR(scene.believed[motors], right[motors], 0.02);
  }
  CHECK(scene.seen.lost == bit(0));
}

TEST_EACH(for_each, "a loose contact is no noise: it is bridged, and fails at the third time") {
  for (int c = 0; c < readings(robot); ++c)
    for (const int lasts : {1, 2, 3}) {
      Scene scene(mechanism);
      CHECK(scene.healthy(200));
      for (int k = 200; k < 310; ++k) {
        static_cast<void>(scene.cycle(k, c, k % 50 < lasts ? 0.3 : 0));
        CHECK((scene.seen.reading[c].health == Health::failed) == (k >= 300));
        if (k < 300) CHECK_NEAR(scene.off(c), 0, 5e-3);
      }
    }
}

TEST("a sensor at which a law holds the platform is not stuck, whatever the motors' encoders say") {
  int stuck = 0;
  for_each([&](const Mechanism& mechanism) {
    const int n = mechanism.robot.motors;
    for (const bool held : {true, false}) {
      Scene scene(mechanism);
      scene.settings.chi2.fill(1e12);  // a geometry so unknown that nothing disagrees
      CHECK(scene.healthy(300));
      if (held) scene.held = 300;
      const Extended rests = scene.read(300);
      for (int k = 300; k < 800; ++k) {
        Extended q_e = rests;
        std::copy_n(scene.read(k).begin(), n, q_e.begin());
        static_cast<void>(scene.cycle(k, q_e));
      }
      for (int c = mechanism.robot.motors; c < readings(mechanism.robot); ++c) {
        if (held) CHECK(scene.seen.reading[c].health == Health::valid);
        stuck += !held && scene.seen.reading[c].symptom == Symptom::stuck;
      }
    }
  });
  CHECK(stuck > 0);
}
