// The simulated loop of an ideal robot: at rest, along a move, on a circle.
#include <numbers>

#include "controllers.hpp"
#include "moves.hpp"

using namespace mechanisms;

TEST_EACH(for_each, "an ideal robot follows a move with full feed-forward, and ends on the spot") {
  check::Random random(61);
  const Coordinates to = any_x(random);
  for (const Law law : kLaws) {
    double strayed = 0;
    Sample last{};
    Prior prior(robot);
    const auto write = [&](const Sample& sample) {
      strayed = std::max(strayed, distance(K, to_pose(K, sample.x), to_pose(K, sample.x_d)));
      last = sample;
    };
    CHECK(run_move(
        Loop(robot, robot, settings_for(robot, law), robot.home, 0, Extras{prior.weighing()}), K,
        robot.home, to, 0.3, 0.2, write));
    CHECK_NEAR(strayed, 0, 2e-3);  // torques are held for 1 ms
    CHECK_NEAR(distance(K, to_pose(K, last.x), to_pose(K, to)), 0, 1e-6);
  }
}

namespace {

/// Lets the law act after some cycles, or never, and passes on its torques.
struct Passing final : Guard {
  int waits = 20, restarts = 0, cycles = 0;
  bool ever = true;
  GuardReport passed;

  void guard(const Robot&, const Setpoint&, const Extended&, Outcome answer,
             const ControlState& state, const FaultMonitor*) TRUEPOSE_BOUNDED override {
    cycles += bool(answer);
    passed.torque = state.torque;
  }
  const GuardReport& report() const TRUEPOSE_BOUNDED override { return passed; }
  bool begins(int cycle) override {
    passed.follows = ever && cycle == waits;
    if (passed.follows) passed.brakes = 0;
    return cycle < waits;
  }
  void restart() override { ++restarts; }
};

}  // namespace

TEST_EACH(for_each,
          "behind a guard that passes all torques a robot moves as without, once it may") {
  check::Random random(67);
  const Coordinates to = any_x(random, 0.5);
  const ControlSettings settings = settings_for(robot, Law::tej);
  MultirateSettings slow;
  slow.every[0] = 4, slow.age[0] = 2;
  const auto logged = [&](Guard* guard, const MultirateSettings* late = nullptr) {
    Extras extras{.bus = late, .late = late};
    extras.guard = guard;
    std::vector<Sample> log;
    CHECK(run_move(Loop(robot, robot, settings, robot.home, 0, extras), K, robot.home, to, 0.1, 0,
                   [&](const Sample& sample) { log.push_back(sample); }));
    return log;
  };
  Passing guard, never;
  never.ever = false;
  const std::vector<Sample> bare = logged(nullptr), guarded = logged(&guard);
  CHECK(guard.restarts == 1 && guard.cycles == guard.waits + 101 && guard.frame == 121);
  CHECK(bare.size() == 101 && guarded.size() == 101);
  for (std::size_t k = 0; k < bare.size(); ++k)
    CHECK(bare[k].x == guarded[k].x && bare[k].machine.torque == guarded[k].machine.torque);
  const Pose late = to_pose(K, logged(nullptr, &slow).back().x);
  CHECK_NEAR(distance(K, to_pose(K, logged(&guard, &slow).back().x), late), 0, 1e-9);
  CHECK(logged(&never).size() == 1);
}

namespace {

/// Largest distance, m, of an ideal H4 from a circle of 50 mm radius that it goes round twice a
/// second, its feed-forward full, its readings exact.
double contouring(const ControlSettings& settings) {
  constexpr double kRadius = 0.05, kTurn = 4 * std::numbers::pi;
  const Robot robot = h4().robot;
  const auto circle = [&](int k) {
    const double angle = kTurn * k * settings.period, c = std::cos(angle), s = std::sin(angle);
    const double v = kRadius * kTurn, a = v * kTurn;
    return Setpoint{{kRadius * c, kRadius * s, -0.42, 0}, {-v * s, v * c}, {-a * c, -a * s}};
  };
  Prior prior(robot);
  Loop loop(robot, robot, settings, circle(0).x, 0, Extras{prior.weighing()});
  double largest = 0;
  CHECK(loop.follow(1500, 2, circle, [&](const Sample& sample) {
    const double out = std::hypot(sample.x[0], sample.x[1]) - kRadius;
    const double off = std::hypot(out, sample.x[2] + 0.42);
    if (sample.time > 0.5) largest = std::max(largest, off);  // it started at rest
  }));
  return largest;
}

}  // namespace

TEST("the velocity filter's lag is no tracking error: a circle stays one, under every law") {
  const Robot robot = h4().robot;
  for (const Law law : kLaws) {
    ControlSettings settings = settings_for(robot, law);
    CHECK(place_poles(robot, robot.home, 150, 1, settings));
    CHECK(contouring(settings) < 3e-6);  // 0.12 mm with the lag, 1.8 at the soft gains
    settings.velocity_bandwidth = 300;
    CHECK(place_poles(robot, robot.home, 40, 1, settings));
    CHECK(contouring(settings) < 5e-5);
  }
}
