// The safety shell around laws of simulated robots: what trips it, how soon, and how it stops.
#include "safety_bench.hpp"

using namespace mechanisms;

namespace {

/// Robots of three kinds of motors and up to six freedoms.
template <class F>
void for_some(F&& f) {
  for_each([&](const Mechanism& mechanism, auto mobility) {
    const std::string name = mechanism.name;
    if (name == "H4" || name == "Delta" || name == "6-UPS" || name == "5-bar")
      f(mechanism, mobility);
  });
}

/// Cycles of at most 10 ms.
[[maybe_unused]] constexpr int kSoon = 10;

}  // namespace

TEST("healthy robots with counts never trip, under every law, in moves of 0.2 s") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    for (const Law law : {Law::joint, Law::tej, Law::cartesian, Law::estimated}) {
      if (law == Law::cartesian && kDof<mobility()> == 6) continue;
      Bench<mobility()> bench(mechanism, law);
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

TEST("robots at rest with readings that never change do not trip, nor do slow ones") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    for (const FeedForward forward : {FeedForward::full, FeedForward::gravity}) {
      Bench<mobility()> bench(mechanism, Law::joint, forward);
      bench.begin();
      bench.run_for(500);
      CHECK(bench.healthy());
      Coordinates near = mechanism.robot.home;
      near[0] += 0.001;
      bench.move(near, 0.5);
      bench.run_for(600);
      bench.move(mechanism.robot.home, 0.02);
      bench.run_for(100);
      CHECK(bench.healthy());
      if (!bench.healthy()) std::printf("%s\n", properties(bench.shell.cause).name);
    }
  });
}

TEST("a frozen frame of all readings is named within 3 cycles; the robot stops as printed") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    for (const bool counted : {false, true})
      for (const Law law : {Law::joint, Law::estimated})
        for (const double speed : {0.02, 0.1, 0.3, 0.6})
          for (const double share : {0.3, 0.5}) {
            Bench<K> bench(mechanism, law);
            bench.begin();
            Coordinates target = mechanism.robot.home;
            target[0] += 0.04;
            bench.move(target, 0.04 * 1.875 / speed);  // the largest speed of a quintic
            bench.run_for(static_cast<int>(share * bench.duration * 1000));
            const double u = bench.clock.time / bench.duration,
                         along = 16 * u * u * (1 - u) * (1 - u);
            Extended frozen{};
            const Joint wanted = bench.shell.wanted;
            const Pose since = bench.plant.pose();
            bool first = true;
            const auto freeze = [&](Extended& q_e, SafetyCycle& cycle, Setpoint&) {
              if (first) frozen = q_e;
              if (!first && counted) cycle.counter.value = bench.frame = bench.frame - 1;
              first = false;
              q_e = frozen;
            };
            bench.cycle(freeze);  // the last fresh one
            CHECK(bench.healthy());
            double counts = 0;  // of the fastest motor, per cycle
            for (int i = 0; i < kDof<K>; ++i)
              counts = std::max(counts, std::fabs(bench.shell.wanted[i] - wanted[i]) /
                                            bench.robot.chain[i].encoder_step);
            const int named = bench.cycles(300, [&] { return bench.shell.causes != 0; }, freeze);
            CHECK(named > 0 && (named <= 3 || (!counted && counts < 1)));
            CHECK(bench.shell.cause == StopCause::stale_frame);
            CHECK(bench.shell.machine.stop == StopKind::brake);
            bench.run_for(200, freeze);
            double most = 0;
            const double now = along * speed;
            CHECK(stopping_distance(bench.robot, bench.limits, counted, now, most));
            const double way = bench.travelled(since);
            CHECK(way <= 1.2 * most);
            if (speed <= 0.3) CHECK(way <= 0.010);
            CHECK(bench.shell.machine.state == SafetyState::fault);
            std::printf("%s %d law %d %.2f m/s at %.1f: named %d, way %.2f mm, bound %.2f mm\n",
                        mechanism.name, counted, static_cast<int>(law), speed, share, named,
                        1e3 * way, 1e3 * most);
          }
  });
}
