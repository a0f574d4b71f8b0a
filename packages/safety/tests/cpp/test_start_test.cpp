// A start that proves itself: healthy robots pass, miswired ones stand still or move a millimetre.
#include "start_bench.hpp"

using namespace mechanisms;

namespace {
/// One sign of each reading, and two exchanged of every pair.
std::vector<Miswiring> miswirings(const Robot& robot, bool incremental) {
  std::vector<Miswiring> all;
  const int e = robot.motors + robot.r;
  for (int a = 0; a < e; ++a) {
    all.push_back({StartFinding::reversed, a, -1, 1, incremental});
    for (int b = a + 1; b < e; ++b)
      if (start_detail::same_unit(robot, a, b))
        all.push_back({StartFinding::exchanged, a, b, 1, incremental});
  }
  return all;
}
}  // namespace

TEST("healthy robots of every kind pass and move by less than a millimetre") {
  for_each_square([&](const Mechanism& mechanism) {
    const Robot robot = limited_robot(mechanism);
    for (const Truth& real : {Truth{1, 1}, {0.7, 0.3}, {0.7, 3}, {1.3, 0.3}, {1.3, 3}}) {
      StartBench bench(robot, real);
      bench.run();
      CHECK(bench.passed());
      CHECK(bench.moved > 1e-5 && bench.moved < 1e-3);
    }
  });
}

TEST_EACH(for_each_square,
          "weak motors, whose pushes deflect the brakes, pass: no brake seems to slip") {
  Robot robot = limited_robot(mechanism);
  for (int i = 0; i < robot.motors; ++i) robot.chain[i].torque_limit /= 4;
  StartBench bench(robot);
  bench.run();
  CHECK(bench.passed() && bench.moved < 1e-3);
}

TEST("brakes that close two milliseconds later than they open, known or not") {
  const Robot robot = h4_with(1);
  StartBench known(robot, {1, 1, 0.018, 0.020}), unknown(robot, {1, 1, 0.018, 0.020});
  known.settings.brake_opens = 0.018;
  known.run();
  unknown.run();
  CHECK(known.passed() && known.moved < 1e-3);
  CHECK(unknown.passed() && unknown.moved < 1e-3);
}

TEST("72 miswirings of an H4 are found and move it by less than a millimetre") {
  int all = 0, named = 0;
  double worst = 0;
  for (const int sensors : {1, 2})
    for (const bool incremental : {true, false}) {
      const Robot robot = h4_with(sensors);
      for (const Miswiring& wrong : miswirings(robot, incremental)) {
        StartBench bench(robot);
        bench.run(wrong);
        ++all;
        named += bench.named(wrong);
        CHECK(bench.named(wrong) || bench.listed(wrong));
        worst = std::max(worst, bench.moved);
      }
    }
  CHECK(all == 72 && named >= 69 && worst < 1e-3);
}

TEST("heavier robots and other poses: every miswiring of incremental encoders is found") {
  const Coordinates from{0.04, -0.03, -0.42, 0.2};
  const Robot robot = h4_with(2);
  for (const Miswiring& wrong : miswirings(robot, true)) {
    StartBench heavy(robot, {1.3, 1}), away(robot, {}, &from);
    heavy.run(wrong);
    away.run(wrong);
    CHECK(heavy.named(wrong) && heavy.moved < 1e-3);
    CHECK(away.named(wrong) && away.moved < 1e-3);
  }
}

TEST("without pulses the test ends at rest: no torque, no motion") {
  StartBench bench(h4_with(1));
  bench.settings.pairs = 0;
  bench.run();
  CHECK(bench.passed() && bench.largest == 0 && bench.moved < 1e-6 && bench.seconds < 1);
}

TEST("frozen readings, brakes that stay closed and motors that pull wrongly never pass") {
  const Robot robot = h4_with(1);
  double worst = 0;
  for (const StartFinding kind : {StartFinding::frozen, StartFinding::wrong_way,
                                  StartFinding::no_motion, StartFinding::no_torque})
    for (int a = 0; a < 4; ++a) {
      const Miswiring wrong{kind, a, (a + 1) % 4, 1, true};
      StartBench bench(robot);
      bench.run(wrong);
      CHECK(bench.test.state == StartState::failed);
      if (kind == StartFinding::no_motion) CHECK(bench.found(kind, a));
      // θ shows motors 3 and 4; nothing but their own readings shows 1 and 2.
      if (kind == StartFinding::frozen && a > 1) CHECK(bench.found(kind, a));
      worst = std::max(worst, bench.moved);
    }
  CHECK(worst < 1e-3);
}

TEST("a brake that does not hold its motor's weight is found") {
  StartBench bench(h4_with(1));
  bench.run({StartFinding::brake_slips, 1});
  CHECK(bench.test.state == StartState::failed && bench.moved < 1e-3);
}

TEST("from an unknown pose, or with contradictory limits, nothing moves") {
  StartBench unknown(h4_with(1)), wrong(h4_with(1));
  unknown.run({}, false);
  CHECK(unknown.found(StartFinding::unknown_pose, -1));
  wrong.limits.torque[2] = NAN;
  start_test(wrong.robot, wrong.settings, wrong.limits, wrong.first, true, wrong.test);
  CHECK(wrong.found(StartFinding::contradictory_limits, -1));
  CHECK(std::isinf(unknown.test.sigma[0]) && unknown.test.scale[0] == 1);
  for (int i = 0; i < 4; ++i) CHECK(wrong.test.torque[i] == 0);
  CHECK(unknown.largest == 0 && unknown.moved < 1e-6 && wrong.test.brakes == 0xF);
}

TEST("a reading that is lost ends the test, whenever it is") {
  for (const int at : {0, 90, 120, 200, 600, 1500}) {
    StartBench bench(h4_with(1));
    bench.spoil = [&](int cycle, Extended& q_e) {
      if (cycle >= at) q_e[3] = NAN;
    };
    bench.run();
    CHECK(bench.found(StartFinding::missing, 3));
    CHECK(bench.moved < 1e-3 && (at > 50 || bench.largest == 0));
  }
}

TEST("hostile readings never raise a torque beyond its limit or open two brakes") {
  check::Random random(7);
  for (int k = 0; k < 20; ++k) {
    StartBench bench(h4_with(2));
    const int from = static_cast<int>(60 + 400 * (1 + random()));
    bench.spoil = [&](int cycle, Extended& q_e) {
      if (cycle > from)
        for (double& q : q_e) q = random() > 0.9 ? 1e300 * random() : q + 0.01 * random();
      CHECK(std::popcount(~bench.test.brakes & 0xFU) <= 1);
    };
    bench.run();
    CHECK(bench.test.state == StartState::failed && bench.moved < 1e-3);
  }
}

TEST("every hypothesis has one number") {
  const int n = 4, e = 6, all = start_detail::hypotheses(n, e);
  std::vector<std::array<int, 3>> seen;
  for (int k = 0; k < all; ++k) {
    const StartHypothesis by = start_detail::hypothesis(n, e, k);
    const std::array<int, 3> key{static_cast<int>(by.kind), by.a, by.b};
    CHECK(std::find(seen.begin(), seen.end(), key) == seen.end());
    CHECK(by.a < e && by.b < e && (k == 0) == (by.kind == StartFinding::none));
    seen.push_back(key);
  }
  CHECK(all == 1 + 21 + 8);
}
