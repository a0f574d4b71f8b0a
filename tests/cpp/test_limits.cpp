// Limits of a control cycle: derived from robots, compared with paths; and the age of frames.
#include "control/command.hpp"
#include "control/limit_check.hpp"
#include "control/limit_defaults.hpp"
#include "controllers.hpp"
#include "rotational.hpp"

using namespace pivots_tested;

namespace {

constexpr std::uint64_t kAll = ~std::uint64_t{0};

Robot with_torque(Robot robot, double most) {
  for (int i = 0; i < robot.motors; ++i) robot.chain[i].torque_limit = most;
  return robot;
}

}  // namespace

TEST("frames that come one a cycle are fresh, also where the counter wraps") {
  for (const int bits : {2, 8, 16, 64}) {
    FrameClock clock;
    const std::uint64_t mask = kAll >> (64 - bits);
    for (std::uint64_t k = 0; k < 1000; ++k)
      CHECK(clock.advance({true, (kAll - 500 + k) & mask}, 1, mask, 2) == FrameAge::fresh);
    CHECK(clock.jitter == 0 && clock.behind == 0);
  }
}

TEST("a repeated frame is repeated, the third in a row too old, whatever marks it") {
  for (const double per : {1.0, 1e6}) {
    FrameClock clock;
    std::uint64_t mark = 7;
    const auto step = static_cast<std::uint64_t>(per);
    for (int k = 0; k < 10; ++k)
      CHECK(clock.advance({true, mark += step}, per, kAll, 2) == FrameAge::fresh);
    FrameClock silent = clock;
    for (const FrameAge age : {FrameAge::repeated, FrameAge::repeated, FrameAge::old}) {
      CHECK(clock.advance({true, mark}, per, kAll, 2) == age);
      CHECK(silent.advance({}, per, kAll, 2) == age);  // a mark that is missing
    }
    CHECK(clock.advance({true, mark}, per, kAll, 2) == FrameAge::old);
    CHECK(clock.advance({true, mark + step}, per, kAll, 2) == FrameAge::fresh);
  }
}

TEST("frames that fall behind bit by bit become too old; a clock that is 0.1 % slow does not") {
  FrameClock clock, drifts;
  int k = 0;
  double late = 0, slow = 0;
  for (; k < 1000; ++k)
    if (clock.advance({true, static_cast<std::uint64_t>(late += 0.98e6)}, 1e6, kAll, 2) ==
        FrameAge::old)
      break;
  CHECK(k > 125 && k < 140);
  for (k = 0; k < 100000; ++k)
    CHECK(drifts.advance({true, static_cast<std::uint64_t>(slow += 0.999e6)}, 1e6, kAll, 2) ==
          FrameAge::fresh);
}

TEST("a jump forward has dropped frames, unless it makes up for late ones; backwards is named") {
  FrameClock clock;
  CHECK(clock.advance({true, 100}, 1, 0xff, 2) == FrameAge::fresh);
  CHECK(clock.advance({true, 103}, 1, 0xff, 2) == FrameAge::fresh);  // two are missing
  CHECK(clock.advance({true, 107}, 1, 0xff, 2) == FrameAge::dropped);
  CHECK(clock.advance({true, 107}, 1, 0xff, 2) == FrameAge::repeated);
  CHECK(clock.advance({true, 107}, 1, 0xff, 2) == FrameAge::repeated);
  CHECK(clock.advance({true, 110}, 1, 0xff, 2) == FrameAge::fresh);
  CHECK(clock.advance({true, 109}, 1, 0xff, 2) == FrameAge::backwards);
  CHECK(clock.advance({true, 110}, 1, 0xff, 2) == FrameAge::fresh);
  CHECK(clock.jitter == 3);
  FrameClock unmarked;
  for (int k = 0; k < 10; ++k) CHECK(unmarked.advance({}, 1, kAll, 2) == FrameAge::fresh);
}

TEST_EACH(for_every, "limits of every robot are consistent, and derived as documented") {
  Robot robot = with_torque(mechanism.robot, 40);
  SafetyLimits limits;
  for (const Gains gains : {Gains::diagonal, Gains::inertia}) {
    const ControlSettings settings = settings_for(robot, Law::joint, gains);
    CHECK(default_limits(robot, settings, limits));
    CHECK(consistent(limits, n, n));
    ControlSettings diagonal = settings_for(robot, Law::joint);
    for (int i = 0; i < n; ++i) {
      CHECK(limits.torque[i] == 40);
      CHECK_NEAR(limits.slew[i], 8000, 1e-9);
      CHECK_NEAR(limits.tracking[i], 40 / diagonal.kp[i], 1e-9 * limits.tracking[i]);
      CHECK(limits.deviation[i] == limits.tracking[i]);
      CHECK_NEAR(limits.kp[i], 1e4, 1e-5);
      CHECK_NEAR(limits.kd[i], 200, 1e-6);
    }
    CHECK_NEAR(limits.saturation, 0.05, 1e-9);
  }
  const SafetyLimits joint = limits;
  CHECK(default_limits(robot, settings_for(robot, Law::tej, Gains::inertia), limits));
  for (int i = 0; i < n; ++i) CHECK(limits.deviation[i] > joint.deviation[i]);
  double slow = 0, fast = 0;
  CHECK(stopping_distance(robot, limits, true, 0.1, slow));
  CHECK(stopping_distance(robot, limits, true, 0.3, fast));
  CHECK(slow >= 0.1 * 0.024 && fast > 3 * slow - 0.003);
  // The speed limit keeps its meaning: faster motors need more room for counts.
  for (const double share : {0.01, 0.3, 0.9}) {
    const double step = robot.chain[0].encoder_step = share * joint.tracking[0];
    CHECK(default_limits(robot, settings_for(robot, Law::joint), limits));
    const double cycles = std::ceil(step / (0.1 * joint.speed[0] * 1e-3));
    CHECK(limits.window >= std::clamp(cycles, 1.0, 8.0) && limits.window <= cycles + 1);
    // The law's answer to a count passes the slew limit: it is no fault.
    CHECK_NEAR(limits.slew[0], std::max(8000.0, 1e3 * std::min(80.0, 2.5 * 40 * share * 31)), 10);
  }
}

TEST("the stops are the motors' range, as their encoders read") {
  const Mechanism mechanism = linear_delta();
  Robot robot = with_torque(mechanism.robot, 40);
  for (int i = 0; i < 3; ++i) {
    robot.chain[i].low = -0.9;
    robot.chain[i].high = 0.9;
    robot.chain[i].encoder_gain = -2;
  }
  CHECK(finish(robot));
  SafetyLimits limits;
  CHECK(default_limits(robot, settings_for(robot, Law::joint), limits));
  for (int i = 0; i < 3; ++i) {
    CHECK_NEAR(limits.low[i], -1.8 - robot.chain[i].encoder_offset, 1e-6);
    CHECK_NEAR(limits.high[i], 1.8 - robot.chain[i].encoder_offset, 1e-6);
  }
}

TEST("without a torque limit or a gain there are no limits, and the motor is named") {
  Mechanism mechanism = delta();
  Robot robot = with_torque(mechanism.robot, 40);
  robot.chain[1].torque_limit = 0;
  SafetyLimits limits;
  Outcome outcome = default_limits(robot, settings_for(robot, Law::joint), limits);
  CHECK(outcome.status == Status::no_such_value && outcome.chain == 1);
  robot.chain[1].torque_limit = 40;
  ControlSettings settings = settings_for(robot, Law::joint);
  settings.kp[2] = 0;
  outcome = default_limits(robot, settings, limits);
  CHECK(outcome.status == Status::no_such_value && outcome.chain == 2);
}

TEST("contradictory limits are refused, and named") {
  const Robot robot = with_torque(delta().robot, 40);
  SafetyLimits good;
  CHECK(default_limits(robot, settings_for(robot, Law::joint), good));
  const auto refused = [&](auto change, int motor) {
    SafetyLimits limits = good;
    change(limits);
    const Outcome outcome = consistent(limits, 3, 3);
    CHECK(outcome.status == Status::no_such_value && outcome.chain == motor);
  };
  using L = SafetyLimits;
  for (Real L::* time : {&L::period, &L::stop, &L::brake, &L::standstill, &L::saturation,
                         &L::clipped, &L::missing, &L::held})
    for (const double bad : {-1.0, std::nan("")}) refused([&](L& l) { l.*time = bad; }, -1);
  for (Real L::* time : {&L::missing, &L::held, &L::period})
    refused([&](L& l) { l.*time = 0.02; }, -1);  // later than the reaction time
  for (Joint L::* each : {&L::torque, &L::slew, &L::tracking, &L::deviation, &L::speed, &L::count,
                          &L::still, &L::kp, &L::kd, &L::rests})
    for (const double bad : {-1.0, std::nan("")}) refused([&](L& l) { (l.*each)[1] = bad; }, 1);
  for (Joint L::* each : {&L::torque, &L::slew, &L::tracking, &L::deviation, &L::speed, &L::still})
    for (const double bad : {0.0, static_cast<double>(INFINITY)})
      refused([&](L& l) { (l.*each)[2] = bad; }, 2);
  refused([](L& l) { l.slew[0] *= 0.9; }, 0);  // the stop's torque would come too late
  refused([](L& l) { l.tracking[0] = l.count[0]; }, 0);
  refused([](L& l) { l.deviation[0] = 0.9 * l.tracking[0]; }, 0);
  refused([](L& l) { l.still[0] = l.count[0]; }, 0);
  refused([](L& l) { l.low[0] = l.high[0] + 1; }, 0);
  refused([](L& l) { l.box_low[2] = 1; }, -1);
  for (const int bad : {0, 9, -1}) refused([&](L& l) { l.window = bad; }, -1);
  for (const int bad : {0, 11, -1}) refused([&](L& l) { l.age = bad; }, -1);
  for (const int bad : {1, 65, -1}) refused([&](L& l) { l.counter_bits = bad; }, -1);
}

TEST("every cause has a name of its own, and those that open the loop say so") {
  for (const CauseProperties& row : kCauseTable) {
    CHECK(properties(row.cause).name == row.name);
    for (const CauseProperties& other : kCauseTable)
      CHECK(row.cause == other.cause || std::string(row.name) != other.name);
    if (row.by_path) CHECK(!row.always);
  }
  CHECK(properties(StopCause::requested).by_path && !properties(StopCause::stale_frame).by_path);
  CHECK(causes_with(&CauseProperties::by_path) ==
        (bit_of(StopCause::requested) | bit_of(StopCause::workspace) |
         bit_of(StopCause::readings_disagree)));
}

TEST("a healthy cycle violates no limit; beyond one its cause and its motor are named") {
  const Robot robot = with_torque(delta().robot, 40);
  SafetyLimits limits;
  CHECK(default_limits(robot, settings_for(robot, Law::joint), limits));
  limits.saturation = 0.0205;
  limits.low.fill(-2);
  limits.high.fill(2);
  limits.box_low.fill(-1);
  limits.box_high.fill(1);
  LimitState rested;
  CheckedCycle healthy;
  CHECK(command(Level::ideal, robot, robot.home, healthy.q_d));
  healthy.x = robot.home;
  healthy.q = rested.wanted = healthy.q_d;
  healthy.counter = {true, 0};
  const auto check = [&](const CheckedCycle& cycle, LimitState& state) {
    return check_limits(3, 3, limits, cycle, true, {}, state);
  };
  for (; healthy.counter.value < 10; ++healthy.counter.value)
    CHECK(check(healthy, rested).causes == 0 && (healthy.counter.value == 0 || rested.have[0] > 1));
  CHECK(rested.seen(3));
  const auto violates = [&](StopCause cause, int motor, int within, auto change) {
    LimitState state = rested;
    CheckedCycle cycle = healthy;
    for (int k = 1; k <= within; ++k, ++cycle.counter.value) {
      change(cycle, k);
      const Violations found = check(cycle, state);
      CHECK((found.causes & bit_of(cause)) == (k < within ? 0 : bit_of(cause)));
      if (k == within) CHECK(found.part[static_cast<std::size_t>(cause)] == motor);
    }
  };
  const Joint& speed = limits.speed;
  violates(StopCause::stale_frame, -1, 3, [](auto& cycle, int) { cycle.counter.value = 9; });
  violates(StopCause::dropped_frames, -1, 1, [](auto& cycle, int) { cycle.counter.value += 4; });
  violates(StopCause::missing_reading, 1, 6, [](auto& cycle, int) { cycle.q[1] = NAN; });
  violates(StopCause::motor_range, 2, 1, [](auto& cycle, int) { cycle.q[2] = 2.01; });
  violates(StopCause::overspeed, 0, 1, [&](auto& cycle, int) {
    cycle.q[0] += 1.1e-3 * speed[0] * limits.window + limits.count[0];
  });
  violates(StopCause::setpoint_speed, 1, 1,
           [&](auto& cycle, int) { cycle.q_d[1] += 1.1e-3 * speed[1]; });
  violates(StopCause::tracking_error, 2, 1,
           [&](auto& cycle, int) { cycle.error[2] = 1.01 * limits.tracking[2]; });
  violates(StopCause::workspace, -1, 1, [](auto& cycle, int) { cycle.x[0] = 1.01; });
  violates(StopCause::no_answer, -1, 6,
           [](auto& cycle, int) { cycle.answer.status = Status::singular; });
  violates(StopCause::saturation, 0, 21, [](auto& cycle, int) { cycle.torque[0] = 40; });
}
