// The safety shell around laws of simulated robots: what trips it, how soon, and how it stops.
#include "moves.hpp"
#include "safety_bench.hpp"

using namespace mechanisms;

TEST("healthy robots with counts never trip, under every law, in moves of 0.2 s") {
  for_each([](const Mechanism& mechanism) {
    for (const Law law : {Law::joint, Law::tej, Law::cartesian, Law::estimated}) {
      if (law == Law::cartesian && dof(mechanism.robot.mobility) == 6) continue;
      Bench bench(mechanism, law);
      bench.begin();
      check::Random random(5);
      for (int m = 0; m < 3; ++m) {
        bench.move(random_pose(mechanism, random, 0.5), 0.2);
        bench.run_for(240);
        CHECK(bench.healthy());
        if (!bench.healthy()) std::printf("%s\n", properties(bench.shell.cause).name);
      }
    }
  });
}

TEST_EACH(for_each,
          "robots at rest with readings that never change do not trip, nor do slow ones") {
  for (const FeedForward forward : {FeedForward::full, FeedForward::gravity}) {
    Bench bench(mechanism, Law::joint, forward);
    bench.begin();
    bench.run_for(500);
    CHECK(bench.healthy());
    Coordinates near = robot.home;
    near[0] += 0.001;
    bench.move(near, 0.5);
    bench.run_for(600);
    bench.move(robot.home, 0.02);
    bench.run_for(100);
    CHECK(bench.healthy());
    if (!bench.healthy()) std::printf("%s\n", properties(bench.shell.cause).name);
  }
}

TEST("no false alarm: healthy robots with friction, ripple and wrong lengths, fast and slow") {
  const long moves = check::sample_size(6);
  long cycles = 0;
  for_each([&](const Mechanism& mechanism) {
    for (const bool marked : {true, false})
      for (const Law law : {Law::joint, Law::tej})
        for (const double friction : {0.0, 0.005}) {
          Bench bench(mechanism, law, {}, {1e-3, friction, 0.02});
          bench.begin();
          check::Random random(31);
          const auto marks = [&](Extended&, SafetyCycle& cycle, Setpoint&) {
            if (!marked) cycle.counter = {};
          };
          bench.shell.counter = {};
          for (long m = 0; m < moves && bench.healthy(); ++m) {
            const double duration = 0.2 * std::pow(10, m % 3 * 0.5);
            bench.move(random_pose(mechanism, random, 0.5), duration);
            const int periods = static_cast<int>(1000 * duration) + 50;
            bench.run_for(periods, marks);
            cycles += periods;
          }
          CHECK(bench.healthy());
          if (!bench.healthy()) std::printf("  %s\n", properties(bench.shell.cause).name);
        }
  });
  CHECK(cycles > 10000 * moves);
}

TEST_EACH(for_each,
          "a frozen frame of all readings is named within 3 cycles; the robot stops as printed") {
  for (const bool counted : {false, true})
    for (const Law law : {Law::joint, Law::estimated})
      for (const double speed : {0.02, 0.1, 0.3, 0.6})
        for (const double share : {0.3, 0.5}) {
          Bench bench(mechanism, law);
          bench.begin();
          Coordinates target = robot.home;
          target[0] += 0.04;
          bench.move(target, 0.04 * 1.875 / speed);  // the largest speed of a quintic
          const auto unmarked = [&](Extended&, SafetyCycle& cycle, Setpoint&) {
            if (!counted) cycle.counter = {};
          };
          if (!counted) bench.shell.counter = {};
          bench.run_for(static_cast<int>(share * bench.duration * 1000), unmarked);
          const double u = bench.clock.time / bench.duration,
                       along = 16 * u * u * (1 - u) * (1 - u);
          Extended frozen{};
          const Joint wanted = bench.shell.wanted;
          const Pose since = bench.plant.pose();
          bool first = true;
          const auto freeze = [&](Extended& q_e, SafetyCycle& cycle, Setpoint& setpoint) {
            unmarked(q_e, cycle, setpoint);
            if (first) frozen = q_e;
            if (!first && counted) cycle.counter.value = bench.frame = bench.frame - 1;
            first = false;
            q_e = frozen;
          };
          bench.cycle(freeze);  // the last fresh one
          CHECK(bench.healthy());
          double counts = 0;  // of the fastest motor, per cycle
          for (int i = 0; i < n; ++i)
            counts = std::max(counts, std::fabs(bench.shell.wanted[i] - wanted[i]) /
                                          bench.robot.chain[i].encoder_step);
          const int named = bench.cycles(300, [&] { return bench.shell.causes != 0; }, freeze);
          // Slower motors may stand within a count for longer.
          const int most_cycles = counted || counts >= 1 ? 3 : 60;
          CHECK(named > 0 && named <= most_cycles);
          CHECK(bench.shell.cause == StopCause::stale_frame);
          CHECK(bench.shell.machine.stop == StopKind::brake);
          bench.run_for(200, freeze);
          double most = 0;
          const double now = along * speed;
          CHECK(stopping_distance(bench.robot, bench.limits, counted, now, most));
          const double way = bench.travelled(since);
          CHECK(way <= 1.2 * most);
          if (counted && speed <= 0.3) CHECK(way <= 0.010);
          CHECK(bench.shell.machine.state == SafetyState::fault);
        }
}

TEST_EACH(for_each,
          "one motor whose encoder freezes in motion is named before its loop has driven it far") {
  for (int motor = 0; motor < n; ++motor) {
    Bench bench(mechanism);
    bench.begin();
    Coordinates target = robot.home;
    target[0] += 0.04;
    bench.move(target, 0.3);
    bench.run_for(150);
    Real frozen = NAN;
    const auto freeze = [&](Extended& q_e, SafetyCycle&, Setpoint&) {
      if (std::isnan(frozen)) frozen = q_e[motor];
      q_e[motor] = frozen;
    };
    const int named = bench.cycles(100, [&] { return bench.shell.causes != 0; }, freeze);
    if (motors == n) {  // else the other motors hold the platform, and correct it little
      CHECK(named > 0 && named <= 100);  // slow motors take the longest
      CHECK(bench.shell.cause == StopCause::stale_frame && bench.shell.part == motor);
    }
    const Setpoint setpoint = quintic(K, bench.from, bench.to, bench.duration, bench.clock.time);
    CHECK(bench.travelled(to_pose(K, setpoint.x)) < 0.040);
  }
}

TEST_EACH(for_each,
          "a requested stop follows the path without a corner, then the brakes hold the robot") {
  Bench bench(mechanism);
  bench.begin();
  Coordinates target = robot.home;
  target[0] += 0.04;
  bench.move(target, 0.3);
  bench.run_for(120);
  bench.request.stop = true;
  double off = 0;
  CHECK(bench.cycles(200, [&] {
    const Setpoint setpoint = quintic(K, bench.from, bench.to, bench.duration, bench.clock.time);
    off = std::max(off, std::fabs(setpoint.x[0] - to_coordinates(K, bench.plant.pose())[0]));
    return bench.shell.machine.stop == StopKind::brake;
  }) >= 150);
  CHECK(off < 1e-3 && bench.clock.rate == 0);
  const Pose rests = bench.plant.pose();
  CHECK(bench.cycles(1000, [&] { return bench.shell.machine.state == SafetyState::stopped; }) > 0);
  bench.run_for(100);
  CHECK(bench.travelled(rests) < 1e-3);
  CHECK(bench.shell.cause == StopCause::requested);
  for (int i = 0; i < n; ++i) CHECK(bench.shell.torque[i] == 0);
}

TEST_EACH(for_each, "a stop of a robot whose setpoint stands still ends within a brake's time") {
  Bench bench(mechanism);
  bench.begin();
  bench.request.stop = true;
  const int closed = bench.cycles(30, [&] { return bench.shell.brakes != 0; });
  CHECK(closed > 20 && closed < 25);
}

TEST_EACH(
    for_each,
    "lost, late and jittering frames of a healthy robot are no violation until one is too old") {
  Bench bench(mechanism);
  bench.begin();
  check::Random random(8);
  Extended last{};
  std::uint64_t mark = 1000;
  const auto late = [&](Extended& q_e, SafetyCycle& cycle, Setpoint& setpoint) {
    static_cast<void>(setpoint);
    const std::uint64_t phase = bench.frame % 20;
    if (phase == 1 || (phase == 2 && bench.frame % 40 == 2)) {  // the frame of phase 0, again
      q_e = last;
      cycle.counter.value = bench.frame - phase;
    }
    const double stamp = 1e6 * (static_cast<double>(cycle.counter.value) + 0.2 * random());
    cycle.time = {true, phase == 1 || (phase == 2 && bench.frame % 40 == 2)
                            ? mark
                            : static_cast<std::uint64_t>(1e6 + stamp)};
    mark = cycle.time.value;
    last = q_e;
  };
  bench.move(any_x(random, 0.5), 0.4);
  bench.run_for(600, late);
  CHECK(bench.healthy());
  if (!bench.healthy()) std::printf("%s\n", properties(bench.shell.cause).name);
  CHECK(bench.shell.counter.jitter >= 1);
}

TEST_EACH(for_each,
          "acknowledged and started after a law without an answer, a monitored robot moves again") {
  if (robot.r == 0) return;
  Bench bench(mechanism);
  FaultTolerantSettings settings;
  prepare(settings.monitor);
  FaultTolerantState monitor;
  bench.monitored = {&settings, &monitor, nullptr};
  for (int i = 0; i < motors; ++i)  // the monitor knows how coarse they count
    bench.prior.known().sigma[i] = bench.robot.chain[i].encoder_step;
  bench.begin();
  const auto none = [](Extended&, SafetyCycle&, Setpoint& setpoint) { setpoint.x[0] = NAN; };
  CHECK(bench.cycles(12, [&] { return bench.shell.causes != 0; }, none) > 0);
  CHECK(bench.shell.cause == StopCause::no_answer);
  bench.run_for(300);
  bench.begin();
  Coordinates target = robot.home;
  target[0] += 0.02;
  bench.move(target, 0.3);
  bench.run_for(400);
  CHECK(bench.healthy() && monitor.brakes == 0);
  CHECK(std::fabs(to_coordinates(K, bench.plant.pose())[0] - target[0]) < 1e-3);
}

TEST("of motors that may be faulty only one that stands still off its setpoint is suspected") {
  FaultMonitor monitor;
  monitor.placed = monitor.undecided = true;
  monitor.doubted = 3;
  SafetyCycle plausible, stuck;
  complete(2, {}, {}, {}, {}, &monitor, plausible);
  CHECK(plausible.disagree && !plausible.lost && plausible.suspected == 0);
  monitor.reading[1].standstill.cycles = kStill;
  monitor.reading[1].standstill.driven.error = 1e-3;
  complete(2, {}, {}, {}, {}, &monitor, stuck);
  CHECK(!stuck.disagree && stuck.lost && stuck.suspected == 2);
}

TEST("a run begins however long the brakes of its safety shell take to open") {
  const Robot robot = limited_robot(h4());
  const ControlSettings settings = settings_for(robot, Law::joint);
  SafetyGuard guard;
  guard.counted = true;
  CHECK(default_limits(robot, settings, guard.limits));
  guard.limits.brake = 1.5;
  Extras extras;
  extras.guard = &guard;
  std::size_t rows = 0;
  CHECK(run_move(Loop(robot, robot, settings, robot.home, 0, extras), robot.mobility, robot.home,
                 robot.home, 0.1, 0, [&](const Sample&) { ++rows; }));
  CHECK(rows == 101);
}
