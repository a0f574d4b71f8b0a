// The start-up test in C does what the core's does, and refuses what is no test.
#include "in_c.hpp"
#include "safety/fields.hpp"
#include "start_bench.hpp"

using namespace mechanisms;

TEST("a start-up test in C passes with the core's torques, brakes and scales") {
  StartBench bench(limited_robot(h4()));
  const ModelInC model(bench.robot);
  const auto limits = in_c(bench.limits);
  truepose_start_test test;
  truepose_start_report report{};
  CHECK(truepose_start_test_init(&test, sizeof test, model, nullptr, &limits).status == 0);
  while (report.state < TRUEPOSE_START_PASSED || bench.test.torque != Joint{}) {
    const Extended q_e = bench.read({});
    CHECK(
        truepose_start_test_cycle(model, &test, q_e.data(), 1, nullptr, nullptr, &report).status ==
        0);
    start_test(bench.robot, {}, bench.limits, q_e, true, bench.test);
    CHECK(std::equal(bench.test.torque.begin(), bench.test.torque.end(), report.torque));
    CHECK(report.brakes == bench.test.brakes && report.motor == bench.test.motor);
    CHECK(report.state == static_cast<int>(bench.test.state));
    bench.plant.work_brakes(report.brakes, bench.limits.period);
    CHECK(bool(bench.plant.advance(bench.test.torque, bench.limits.period, 2)));
  }
  CHECK(report.state == TRUEPOSE_START_PASSED && report.finding == 0);
  CHECK(std::equal(bench.test.scale.begin(), bench.test.scale.end(), report.scale));
}

TEST("limits that contradict themselves, and a test that is none, are refused") {
  const StartBench bench(limited_robot(h4()));
  const ModelInC model(bench.robot), held(four_rrr().robot);
  auto limits = in_c(bench.limits);
  truepose_start_test test{};
  truepose_start_report report{};
  truepose_start_settings settings;
  report.state = 77;
  truepose_start_defaults(&settings);
  CHECK(settings.motion == StartSettings{}.motion && settings.size == sizeof settings);
  const auto status = [](truepose_outcome outcome) { return static_cast<Status>(outcome.status); };
  const auto begun = [&](std::size_t size) {
    return status(truepose_start_test_init(&test, size, model, &settings, &limits));
  };
  const auto cycle = [&](int referenced) {
    return status(truepose_start_test_cycle(model, &test, bench.first.data(), referenced, nullptr,
                                            nullptr, &report));
  };
  CHECK(cycle(1) == Status::unfinished && report.state == 77);
  CHECK(status(truepose_start_test_init(&test, sizeof test, held, nullptr, &limits)) ==
        Status::not_square);
  CHECK(begun(truepose_start_test_size() - 1) == Status::too_small);
  settings.size = 3;
  CHECK(begun(sizeof test) == Status::other_version);
  settings.size = sizeof settings;
  limits.torque[1] = NAN;
  CHECK(begun(sizeof test) == Status::no_such_value);
  limits.torque[1] = bench.limits.torque[1];
  CHECK(begun(sizeof test) == Status::ok);
  CHECK(cycle(0) == Status::ok && report.state == TRUEPOSE_START_FAILED);
  CHECK(std::string(truepose_start_finding_text(report.finding)) == "unknown pose");
  CHECK(std::string(truepose_start_finding_text(99)).empty());
}
