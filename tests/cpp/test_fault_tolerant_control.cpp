// The fault-tolerant controller under faults. It changes without a
// step, stops, asks for brakes, and is reset.
#include <algorithm>

#include "control/fault_tolerant_control.hpp"
#include "control/limit_defaults.hpp"
#include "mechanisms.hpp"
#include "moves.hpp"

using namespace mechanisms;

namespace {

constexpr double kPeriod = 1e-3;

/// A robot at rest, its readings off by what no calibration has told, under a fault-tolerant law.
struct FaultTolerantRobot {
  explicit FaultTolerantRobot(const Mechanism& mechanism)
      : K(mechanism.robot.mobility),
        n(mechanism.robot.motors),
        robot(mechanism.robot),
        prior(robot) {
    known = !!place_poles(robot, robot.home, 100, 1, settings);
    fault_settings.monitor.fastest.fill(500);
    prepare(fault_settings.monitor);
    Robot truth = robot;
    for (int i = 0; i < robot.motors; ++i) truth.chain[i].encoder_offset += 2e-4 * (i + 1);
    known = known && extended(Level::ideal, truth, to_pose(K, robot.home), readings);
    setpoint.x = robot.home;
  }
  Outcome cycle(const Extended& q_e) {
    return control_fault_tolerant(robot, settings, fault_settings, setpoint, q_e, state,
                                  prior.weighing(), fault_state);
  }
  /// What the motors hold at home.
  Joint weight() const {
    Joint torque{};
    CHECK(inverse_dynamics(robot, to_pose(K, robot.home), {}, {}, torque));
    return torque;
  }

  Mobility K;
  int n;
  Robot robot;
  Prior prior;
  bool known;  ///< the robot has gains, and readings
  ControlSettings settings;
  FaultTolerantSettings fault_settings;
  Setpoint setpoint;
  Extended readings{};
  ControlState state;
  FaultTolerantState fault_state;
};

}  // namespace

TEST("a robot that must stop comes to rest along its path, without a corner") {
  PathClock clock;
  for (int k = 0; k < 100; ++k) clock.advance(kPeriod, 0);
  CHECK(std::fabs(clock.time - 0.1) < 1e-12);
  double before = clock.time, rate = 1;
  for (int k = 0; k < 200; ++k) {
    clock.advance(kPeriod, 0.1);
    CHECK(clock.time >= before);
    CHECK(std::fabs(clock.rate - rate - kPeriod * clock.slowing) < 1e-12);
    CHECK(std::fabs(clock.slowing) < 1.51 / 0.1);
    rate = clock.rate;
    before = clock.time;
  }
  CHECK(clock.rate == 0);
  CHECK(std::fabs(clock.time - 0.15) < 1e-3);  // half as far as it would have come
}

TEST("a stop that has to be shorter on the way goes on with the rate that it has") {
  PathClock clock;
  for (int k = 0; k < 50; ++k) clock.advance(kPeriod, 0.15);
  double rate = clock.rate;
  for (int k = 0; k < 27; ++k) {  // two thirds are left, of 40 ms
    clock.advance(kPeriod, 0.04);
    CHECK(rate - clock.rate < 1.51 / 40);
    CHECK(rate >= clock.rate);
    rate = clock.rate;
  }
  CHECK(rate == 0);
}

TEST_EACH(for_each, "a change of law, or of the geometry, is no step of the torque") {
  Robot robot = mechanism.robot;
  robot.chain[0].torque_limit = 0;
  Robot truth = robot;
  for (int i = 0; i < robot.motors; ++i) truth.chain[i].encoder_offset += 2e-3 * (i + 1);
  ControlSettings settings;
  if (!place_poles(robot, robot.home, 100, 1, settings)) return;
  Knowledge known;
  known.sigma.fill(1e-4);
  std::vector<double> work(static_cast<std::size_t>(estimate_work(robot, 0)));
  const Weighing weighing{&known, work.data()};
  Extended q_e{};
  CHECK(extended(Level::ideal, truth, to_pose(K, robot.home), q_e));
  Setpoint setpoint;
  setpoint.x = robot.home;
  ControlState state;
  Joint last{};
  bool first = true;
  for (const Law law : {Law::joint, Law::tej, Law::estimated, Law::joint}) {
    settings.law = law;
    for (int k = 0; k < 300; ++k) {
      CHECK(control(robot, settings, setpoint, q_e, state, weighing));
      for (int i = 0; i < motors; ++i) {
        // A smooth fade over 0.2 s: 1.5/200 of the difference in a cycle, which the errors bound.
        const double most = 1e-9 + 0.02 * settings.kp[i];
        CHECK(first || std::fabs(state.torque[i] - last[i]) < most);
      }
      last = state.torque;
      first = false;
    }
  }
}

TEST_EACH(for_each,
          "without an answer the brakes are asked for, and after a reset the next is led in") {
  FaultTolerantRobot scene(mechanism);
  if (!scene.known) return;
  scene.settings.ki.fill(1);
  scene.setpoint.rate[0] = 0.01;
  scene.setpoint.acceleration[0] = 1;  // what gravity asks for has no part in it
  for (int k = 0; k < 200; ++k) CHECK(scene.cycle(scene.readings));
  scene.setpoint.rate[0] = scene.setpoint.acceleration[0] = 0;
  const Joint weight = scene.weight();
  for (int i = 0; i < scene.n; ++i)  // less than gravity asks for
    scene.robot.chain[i].torque_limit = 0.5 * std::fabs(weight[i]) + 1e-3;
  for (int k = 0; k < 50; ++k) {
    scene.setpoint.x[0] = NAN;  // all readings are well: nothing else is replaced
    CHECK(!scene.cycle(scene.readings));
    CHECK((scene.fault_state.unanswered > scene.fault_settings.monitor.held) ==
          scene.fault_state.stops);
  }
  for (int i = 0; i < scene.n; ++i) {
    CHECK(std::fabs(scene.state.torque[i]) <= scene.robot.chain[i].torque_limit);
    scene.robot.chain[i].torque_limit = 0;
  }
  scene.setpoint.x = scene.robot.home;
  for (int k = 0; k < 50; ++k) {  // an answer opens no brake
    CHECK(scene.cycle(scene.readings));
    CHECK(scene.fault_state.brakes == bit(scene.n) - 1);
  }
  Joint last = weight;
  acknowledge(scene.fault_state, 0);
  CHECK(!scene.fault_state.stops && scene.fault_state.brakes == 0);
  for (int k = 0; k < 300; ++k) {
    CHECK(scene.cycle(scene.readings));
    for (int i = 0; i < scene.n; ++i)  // the errors are 2e-4 and more
      CHECK(std::fabs(scene.state.torque[i] - last[i]) < 1e-5 + 5e-5 * scene.settings.kp[i]);
    last = scene.state.torque;
  }
  CHECK(!scene.fault_state.stops);
}

TEST_EACH(for_each,
          "once all brakes are asked for, the torques hold the robot's weight, whatever is read") {
  FaultTolerantRobot scene(mechanism);
  if (!scene.known) return;
  for (int k = 0; k < 100; ++k) CHECK(scene.cycle(scene.readings));
  const Joint weight = scene.weight();
  scene.fault_state.monitor.undecided = true;
  for (int k = 0; k < 400; ++k) {
    Extended q_e = scene.readings;  // a motor by whose reading a loop would shake
    q_e[0] += k % 2 ? 1e-4 : -1e-4;
    static_cast<void>(scene.cycle(q_e));
    CHECK(scene.fault_state.stops && scene.fault_state.stop == scene.fault_settings.monitor.stop);
    const bool all = scene.fault_state.brakes == bit(scene.n) - 1;
    CHECK(k < 149 ? !all : all || k < 151);
    for (int i = 0; i < scene.n && all; ++i)
      CHECK(std::fabs(scene.state.torque[i] - weight[i]) < 1e-9 * (1 + std::fabs(weight[i])));
  }
}

TEST_EACH(for_each, "a frame that repeats, or a motor beyond its speed, closes all brakes") {
  for (const bool jumps : {false, true}) {
    FaultTolerantRobot scene(mechanism);
    if (!scene.known) return;
    SafetyLimits& limits = scene.fault_settings.limits;
    for (int i = 0; i < scene.n; ++i) scene.robot.chain[i].torque_limit = 1e3;
    if (!default_limits(scene.robot, scene.settings, limits)) return;
    limits.speed.fill(1e-2);
    scene.fault_settings.limited = true;
    scene.fault_settings.monitor.fastest.fill(0);  // the monitor itself tests no jump
    scene.fault_settings.monitor.chi2.fill(1e12);
    FrameMark& frame = scene.fault_state.frame;
    frame.given = true;
    for (int k = 0; k < 100; ++k) {
      ++frame.value;
      CHECK(scene.cycle(scene.readings));
      CHECK(!scene.fault_state.stops && scene.fault_state.cause == StopCause::none);
    }
    for (int k = 0; k < 5; ++k) {
      Extended q_e = scene.readings;
      frame.value += jumps;
      if (jumps) q_e[0] += 1e-3 * (k + 1);
      static_cast<void>(scene.cycle(q_e));
    }
    CHECK(scene.fault_state.brakes == bit(scene.n) - 1 && scene.fault_state.stops);
    CHECK(scene.fault_state.cause == (jumps ? StopCause::overspeed : StopCause::stale_frame));
    acknowledge(scene.fault_state, 0);
    CHECK(scene.fault_state.brakes == 0 && scene.fault_state.cause == StopCause::none);
  }
}

TEST_EACH(for_each, "a lost motor follows its feed-forward into its brake until it is restored") {
  for (const Gains gains : {Gains::diagonal, Gains::inertia}) {
    FaultTolerantRobot scene(mechanism);
    if (!scene.known) return;
    scene.settings.gains = gains;
    CHECK(place_poles(scene.robot, scene.robot.home, 100, 1, scene.settings));
    scene.settings.law = Law::tej;
    scene.fault_settings.monitor.replaceable = 1e-12;
    for (int k = 0; k < 100; ++k) CHECK(scene.cycle(scene.readings));
    const Joint weight = scene.weight();
    Extended q_e = scene.readings;
    q_e[0] = NAN;
    for (int k = 0; k < 300; ++k) {
      if (k == 100)
        scene.fault_settings.monitor.replaceable = 1e9;  // now something could stand for it
      CHECK(scene.cycle(q_e).status == Status::disagree);
      const bool lost = k >= scene.fault_settings.monitor.coast;
      CHECK(scene.fault_state.brakes == (lost ? bit(0) : 0));
      CHECK(scene.fault_state.monitor.lost == scene.fault_state.brakes);
      CHECK(scene.fault_state.stop == (lost ? scene.fault_settings.monitor.stop_lost : 0));
      if (lost) CHECK(std::fabs(scene.state.torque[0] - weight[0]) < 1e-9);
    }
    acknowledge(scene.fault_state, 0);
    Joint last = scene.state.torque;
    for (int k = 0; k < 300; ++k) {
      CHECK(scene.cycle(scene.readings));
      CHECK(scene.fault_state.brakes == 0 && scene.fault_state.monitor.lost == 0);
      if (gains == Gains::diagonal)  // the errors are 2e-4 and more
        CHECK(std::fabs(scene.state.torque[0] - last[0]) < 1e-9 + 5e-5 * scene.settings.kp[0]);
      last = scene.state.torque;
    }
  }
}

TEST_EACH(for_each, "a learner goes back to before the lines of a reading that has failed since") {
  Robot truth = robot;
  for (int i = 0; i < motors; ++i) truth.chain[i].rod += 1e-4 * (i - 1);
  Prior prior(robot);
  OnlineCalibrator learner = prior.learner(robot);
  CHECK(roll_back(learner));  // nothing yet
  check::Random random(72);
  const auto xi = [&] {
    return std::vector<double>(learner.state.xi, learner.state.xi + parameter_count(robot));
  };
  std::vector<std::vector<double>> past;  // what it knew before each line
  for (int k = 0; k < 40; ++k) {
    Extended q_e{};
    CHECK(extended(Level::ideal, truth, any_pose(random, 0.5), q_e));
    past.push_back(xi());
    CHECK(calibrate_online(learner, q_e));
  }
  CHECK(roll_back(learner));
  const std::vector<double> now = xi();
  CHECK(std::find(past.end() - 2 * kSavePeriod, past.end(), now) != past.end());
  Robot known = robot;
  CHECK(set_parameters(robot, now.data(), known));
  for (int i = 0; i < motors; ++i) CHECK(learner.robot.chain[i].rod == known.chain[i].rod);
  CHECK(learner.state.test.cusum == 0);
}

TEST_EACH(for_each,
          "a fault-tolerant robot learns nothing of a reading that is bridged or has failed") {
  for (const FaultKind kind : {FaultKind::spike, FaultKind::jump, FaultKind::dropout}) {
    Prior prior(robot), learnt(robot);
    OnlineCalibrator learner = learnt.learner(robot);
    ControlSettings settings;
    if (!place_poles(robot, robot.home, 100, 1, settings)) return;
    FaultTolerantSettings fault_settings;
    fault_settings.monitor.fastest.fill(500);
    prepare(fault_settings.monitor);
    FaultyReadings faults({{kind, 0, 0, 0.3, 0.06}}, settings.period);
    Extras extras{prior.weighing()};
    extras.calibrator = &learner;
    extras.faults = &faults;
    extras.fault_settings = &fault_settings;
    extras.monitor_weighing = prior.weighing();
    check::Random random(73);
    long lines = 0;
    bool lied = false;
    const auto write = [&](const Sample& sample) {
      lied = lied || sample.health[0] != Health::valid;
      if (!lied) lines = learner.lines;
    };
    CHECK(run_move(Loop(robot, robot, settings, robot.home, 0, extras), K, robot.home,
                   any_x(random, 0.3), 0.1, 0.02, write));
    CHECK(lied && lines > 0);
    CHECK(learner.left_out == 0);  // such a line fits nothing
    CHECK(kind == FaultKind::spike ? learner.lines > lines : learner.lines == lines);
  }
}
