// The safety shell by itself: every limit, refusals, acknowledgements.
#include <functional>

#include "guarded.hpp"

using namespace pivots_tested;

TEST_EACH(for_some_guarded, "a healthy robot runs for as long as it may") {
  Guarded scene(mechanism);
  scene.to_running();
  scene.run_for(3000);
  CHECK(scene.shell.follows && scene.shell.causes == 0);
  CHECK(scene.shell.counter.jitter == 0 && scene.shell.time.jitter < 1e-9);
}

TEST_EACH(for_each, "a motor that friction holds on either side of its setpoint is no frozen one") {
  for (const bool beyond : {false, true}) {
    Guarded scene(mechanism);
    scene.to_running();
    const SafetyLimits& limits = scene.limits;
    const double held = 0.9 * limits.rests[0], off = beyond ? 0.9 * limits.tracking[0] : held;
    const double stays = scene.healthy().q[0];
    const int within = scene.until_stop(1000, [&](SafetyCycle& cycle, int k) {
      cycle.q[0] = stays;
      cycle.error[0] = off - (held + off) * 0.5 * (1 + std::cos(0.01 * k));  // from -held to off
      cycle.q_d[0] = stays + cycle.error[0];
    });
    CHECK((within > 0) == beyond);
    if (beyond) CHECK(scene.shell.cause == StopCause::stale_frame && scene.shell.part == 0);
  }
}

TEST_EACH(for_some_guarded,
          "every violation stops a running robot for its cause, within 10 ms beyond its own time") {
  using Change = std::function<void(SafetyCycle&, int)>;
  Guarded scene(mechanism);
  scene.limits.low.fill(-1e3);
  scene.limits.high.fill(1e3);
  for (int j = 0; j < n; ++j) {
    scene.limits.box_low[j] = robot.home[j] - 0.03;
    scene.limits.box_high[j] = robot.home[j] + 0.03;
  }
  scene.to_running();
  const SafetyLimits& limits = scene.limits;
  const double per_cycle = limits.speed[0] * limits.period;
  const int saturated = static_cast<int>(limits.saturation / limits.period) + 2;
  const int drift = static_cast<int>(std::ceil(limits.deviation[0] / (0.8 * per_cycle)));
  using enum StopCause;
  struct Case {
    StopCause cause;
    int within;
    Change change;
    StopKind stop = StopKind::brake;
  };
  const FrameMark counter{true, scene.frame}, stamp{true, 1'000'000 * scene.frame};
  std::vector<Case> cases{
      {tracking_error, 1,
       [&](SafetyCycle& cycle, int) { cycle.error[0] = 1.01 * limits.tracking[0]; }},
      {tracking_error, 1, [&](SafetyCycle& cycle, int) { cycle.error[n - 1] = NAN; }},
      {tracking_error, drift + 1,
       [&](SafetyCycle& cycle, int k) { cycle.q[0] += 0.8 * per_cycle * k; }},
      {overspeed, 10,
       [&](SafetyCycle& cycle, int k) {
         cycle.q[0] += 1.2 * per_cycle * k;
         cycle.q_d[0] += 0.9 * per_cycle * k;
       }},
      {setpoint_speed, 1, [&](SafetyCycle& cycle, int) { cycle.q_d[0] += 1.5 * per_cycle; }},
      {saturation, saturated, [&](SafetyCycle& cycle, int) { cycle.torque[0] = limits.torque[0]; }},
      {torque_rate, 12,
       [&](SafetyCycle& cycle, int k) {
         cycle.torque[0] = (k % 2 ? 0.9 : -0.9) * limits.torque[0];
       }},
      {motor_range, 1, [&](SafetyCycle& cycle, int) { cycle.q[0] = 1.1e3; }},
      {missing_reading, 6, [](SafetyCycle& cycle, int) { cycle.q[0] = NAN; }},
      {missing_reading, 6, [&](SafetyCycle& cycle, int) { cycle.q[n - 1] = 1e300; }},
      {stale_frame, 3, [&](SafetyCycle& cycle, int) { cycle.counter = counter; }},
      {stale_frame, 3, [&](SafetyCycle& cycle, int) { cycle.time = stamp; }},
      {stale_frame, 3, [&](SafetyCycle& cycle, int) { cycle.counter = {}; }},
      {dropped_frames, 1, [](SafetyCycle& cycle, int) { cycle.counter.value += 4; }},
      {clock_backwards, 1, [](SafetyCycle& cycle, int) { cycle.time.value -= 3'000'000; }},
      {clock_backwards, 1, [](SafetyCycle& cycle, int) { cycle.counter.value -= 2; }},
      {suspected_motor, 1, [](SafetyCycle& cycle, int) { cycle.lost = true; }},
      {readings_disagree, 1, [](SafetyCycle& cycle, int) { cycle.disagree = true; },
       StopKind::path},
      {no_answer, 6, [](SafetyCycle& cycle, int) { cycle.answer = {Status::singular, -1}; }},
      {unknown_pose, 1, [](SafetyCycle& cycle, int) { cycle.known = false; }},
      {workspace, 1, [](SafetyCycle& cycle, int) { cycle.x[0] += 0.04; }, StopKind::path},
      {requested, 1, [](SafetyCycle& cycle, int) { cycle.request.stop = true; }, StopKind::path},
      {requested, 1,
       [](SafetyCycle& cycle, int) {
         cycle.request.stop = true;
         cycle.suspected = 1;
       }},
  };
  for (const Case& one : cases) {
    Guarded copy = scene;
    const int within = copy.until_stop(one.within + 5, one.change);
    const bool right = copy.shell.cause == one.cause && copy.shell.machine.stop == one.stop &&
                       within > 0 && within <= one.within;
    CHECK(right);
    if (!right)
      std::printf("  %s: %s after %d cycles, stop %d\n", properties(one.cause).name,
                  properties(copy.shell.cause).name, within,
                  static_cast<int>(copy.shell.machine.stop));
    // What happens then is known: brakes, holding torque, zero; latched.
    copy.run_for(copy.rest());
    CHECK(copy.shell.machine.state ==
          (one.cause == StopCause::requested ? SafetyState::stopped : SafetyState::fault));
    for (int i = 0; i < n; ++i) CHECK(copy.shell.torque[i] == 0);
    CHECK(copy.shell.brakes == bit(n) - 1 && copy.shell.cause == one.cause);
  }
}

TEST_EACH(for_some_guarded, "a motor may be at its torque limit for a while, again and again") {
  Guarded scene(mechanism);
  scene.to_running();
  const SafetyLimits& limits = scene.limits;
  const int half = static_cast<int>(limits.saturation / limits.period) / 2;
  const auto at_limit = [&](SafetyCycle& cycle, int k) {
    cycle.torque[0] = (k % (2 * half) < half ? 1 : 0.999) * limits.torque[0];
  };
  CHECK(scene.until_stop(20 * half, at_limit) == -1);
  CHECK(scene.shell.follows && scene.shell.causes == 0);
}

TEST_EACH(for_some_guarded, "bad input has one status each, and nothing moves") {
  using Change = std::function<void(Guarded&, SafetyCycle&)>;
  const auto cause = [](auto set) { return [=](Guarded&, SafetyCycle& cycle) { set(cycle); }; };
  const std::vector<std::pair<StopCause, Change>> cases{
      {StopCause::unknown_pose, cause([](SafetyCycle& cycle) { cycle.known = false; })},
      {StopCause::missing_reading, cause([](SafetyCycle& cycle) { cycle.q[0] = NAN; })},
      {StopCause::no_answer,
       cause([](SafetyCycle& cycle) { cycle.answer = {Status::unreachable, 0}; })},
      {StopCause::tracking_error, cause([](SafetyCycle& cycle) { cycle.error[0] = 10; })},
      {StopCause::clock_backwards,
       [](Guarded& scene, SafetyCycle& cycle) {
         cycle.time.value = 5'000'000 - 1'000 * scene.frame;
       }},
      {StopCause::stale_frame, cause([](SafetyCycle& cycle) {
         cycle.counter.value = std::min<std::uint64_t>(cycle.counter.value, 20);
       })},
      {StopCause::requested, cause([](SafetyCycle& cycle) { cycle.request.stop = true; })},
      {StopCause::contradictory_limits,
       [](Guarded& scene, SafetyCycle&) { scene.limits.still[0] = 0; }},
      {StopCause::contradictory_limits,
       [](Guarded& scene, SafetyCycle&) { scene.limits.speed[0] = NAN; }},
      {StopCause::contradictory_limits,
       [](Guarded& scene, SafetyCycle&) { scene.limits.window = 9; }},
  };
  for (const auto& [why, change] : cases) {
    for (const bool start : {false, true}) {  // an acknowledgement is refused, and a start
      Guarded scene(mechanism);
      if (start) scene.to_ready();
      StopCause refused = StopCause::none;
      for (int k = 0; k < 60; ++k) {
        SafetyCycle cycle = scene.healthy();
        change(scene, cycle);
        const bool asks = k == 50;
        (start ? cycle.request.start : cycle.request.acknowledge) = asks;
        scene.step(cycle);
        if (asks) refused = scene.shell.refused;
        CHECK(scene.shell.brakes == bit(n) - 1 && !scene.shell.follows);
        for (int i = 0; i < n; ++i) CHECK(scene.shell.torque[i] == 0);
      }
      // In `ready` what always counts is a fault at once, in which a start is refused as such.
      CHECK(refused == why);
      if (refused != why) std::printf("  %s: %s\n", properties(why).name, properties(refused).name);
      const bool fault = properties(why).always;
      CHECK(scene.shell.machine.state == (fault   ? SafetyState::fault
                                          : start ? SafetyState::ready
                                                  : SafetyState::stopped));
      if (fault) CHECK(scene.shell.cause == why);
    }
  }
}

TEST_EACH(for_some_guarded,
          "a fault is left only by an acknowledgement without its cause, and a start that is new") {
  Guarded scene(mechanism);
  scene.to_running();
  SafetyShell& shell = scene.shell;
  const auto lose = [](SafetyCycle& cycle, int) { cycle.lost = true; };
  CHECK(scene.until_stop(1, lose) == 1);
  scene.run_for(scene.rest());
  CHECK(shell.machine.state == SafetyState::fault && shell.cause == StopCause::suspected_motor);
  scene.request.start = true;  // held from here on
  scene.run_for(3);
  CHECK(shell.machine.state == SafetyState::fault);
  SafetyCycle persists = scene.healthy();
  persists.lost = persists.request.acknowledge = true;
  scene.step(persists);
  CHECK(shell.machine.state == SafetyState::fault && shell.refused == StopCause::suspected_motor);
  scene.request.acknowledge = true;  // also held: it began while the cause persisted
  scene.run_for(20);
  CHECK(shell.machine.state == SafetyState::fault);
  scene.request.acknowledge = false;
  scene.run_for(1);
  scene.press(&SafetyRequests::acknowledge);
  CHECK(shell.machine.state == SafetyState::ready && shell.cause == StopCause::none);
  scene.run_for(20);
  CHECK(shell.machine.state == SafetyState::ready);
  scene.request.start = false;
  scene.run_for(1);
  scene.press(&SafetyRequests::start);
  CHECK(shell.machine.state == SafetyState::running);
  scene.run_for(100);
  CHECK(shell.follows && shell.causes == 0);
  scene.press(&SafetyRequests::stop);
  CHECK(shell.machine.stop == StopKind::path && shell.path_stop == scene.limits.stop);
  scene.run_for(scene.rest());
  CHECK(shell.machine.state == SafetyState::stopped && shell.cause == StopCause::requested);
  scene.press(&SafetyRequests::start);
  CHECK(shell.refused == StopCause::not_ready && shell.machine.state == SafetyState::stopped);
}

TEST_EACH(
    for_some_guarded,
    "after a requested stop a violation is the cause; frames at half the rate hide no overspeed") {
  Guarded scene(mechanism);
  scene.to_running();
  Guarded halved = scene;
  scene.press(&SafetyRequests::stop);
  scene.run_for(scene.rest());
  CHECK(scene.shell.cause == StopCause::requested);
  SafetyCycle cycle = scene.healthy();
  cycle.lost = true;
  scene.step(cycle);
  CHECK(scene.shell.machine.state == SafetyState::fault);
  CHECK(scene.shell.cause == StopCause::suspected_motor);

  halved.limits.deviation.fill(1e3);  // the speed alone
  const double per_cycle = halved.limits.speed[0] * halved.limits.period;
  SafetyCycle last = halved.healthy();
  halved.step(last);
  const auto half = [&](double speed) {
    return [&, speed](SafetyCycle& now, int k) {
      now.q[0] += speed * per_cycle * k;
      now.q_d[0] += 0.8 * std::min(speed, 1.0) * per_cycle * k;
      if (k % 2) {  // the frame of the last cycle, again
        now.q = last.q;
        now.counter = last.counter;
        now.time = last.time;
      }
      last = now;
    };
  };
  Guarded slow = halved;
  const SafetyCycle start = last;
  CHECK(slow.until_stop(30, half(0)) == -1);
  last = start;
  const int within = halved.until_stop(20, half(1.5));
  CHECK(within > 0 && within <= 10);
  CHECK(halved.shell.cause == StopCause::overspeed);
}
