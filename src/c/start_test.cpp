// The start-up test for C.
#include "control/start_test.hpp"
#include "c/controllers.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
struct Start : InMemory<truepose_start_test, Start, 0x74726153U> {
  StartSettings settings;
  SafetyLimits limits;
  StartTest test;
};
}  // namespace
}  // namespace truepose::c

extern "C" {
const char* truepose_start_finding_text(int32_t finding) {
  const auto at = static_cast<std::size_t>(finding);
  return at < kStartFindings.size() ? kStartFindings[at] : "";
}

void truepose_start_defaults(truepose_start_settings* settings) {
  c::describe(StartSettings{}, *settings);
}

size_t truepose_start_test_size(void) { return sizeof(c::Start); }

truepose_outcome truepose_start_test_init(truepose_start_test* test, size_t size,
                                          const truepose_model* model,
                                          const truepose_start_settings* settings,
                                          const truepose_safety_limits* limits) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    truepose_safety_limits all;
    const Status status = c::take(*limits, SafetyLimits{}, all);
    if (status != Status::ok) return {status, -1};
    if (settings && settings->size != sizeof *settings) return {Status::other_version, -1};
    SafetyLimits core;
    fields(all, core, c::Copy<true>{});
    const int n = dof(robot.mobility);
    const Outcome outcome = consistent(core, n, n);
    if (!outcome) return outcome;
    c::Start* made = c::Start::make(test, size);
    if (made == nullptr) return {Status::too_small, -1};
    made->limits = core;
    if (settings) fields(*settings, made->settings, c::Copy<true>{});
    return {};
  });
}

truepose_outcome truepose_start_test_cycle(const truepose_model* model, truepose_start_test* test,
                                           const truepose_real* q_e, int32_t referenced,
                                           const truepose_knowledge* known, truepose_real* work,
                                           truepose_start_report* report) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    c::Start* made = c::Start::of(test);
    if (made == nullptr) return c::kUnfinished;
    const c::Known by(robot, known, work);
    if (!by.sound) return by.sound;
    start_test(robot, made->settings, made->limits, c::values<Extended>(q_e), referenced != 0,
               made->test, by.weighing);
    const StartTest& now = made->test;
    *report = truepose_start_report{};
    report->state = static_cast<std::int32_t>(now.state);
    report->finding = static_cast<std::int32_t>(now.finding);
    report->part = now.part;
    report->other = now.other;
    report->candidates = now.candidates;
    report->exchangeable = now.exchangeable;
    report->brakes = now.brakes;
    report->motor = now.motor;
    c::give(now.torque, report->torque);
    c::give(now.scale, report->scale);
    c::give(now.sigma, report->sigma);
    return {};
  });
}
}
