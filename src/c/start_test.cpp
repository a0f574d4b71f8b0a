// The start-up test for C.
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
  *settings = c::converted<truepose_start_settings>(StartSettings{});
}

size_t truepose_start_test_size(void) { return sizeof(c::Start); }

truepose_outcome truepose_start_test_init(truepose_start_test* test, size_t size,
                                          const truepose_model* model,
                                          const truepose_start_settings* settings,
                                          const truepose_safety_limits* limits) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    SafetyLimits all;
    Status status = c::take(*limits, all);
    if (settings && settings->size != sizeof *settings) status = Status::other_version;
    if (status != Status::ok) return {status, -1};
    if (overdriven(robot)) return {Status::not_square, -1};  // locked by the others' brakes
    const Outcome outcome = consistent(all, robot.motors, dof(robot.mobility));
    if (!outcome) return outcome;
    c::Start* made = c::Start::make(test, size);
    if (made == nullptr) return c::kTooSmall;
    made->limits = all;
    if (settings) made->settings = c::converted<StartSettings>(*settings);
    return {};
  });
}

truepose_outcome truepose_start_test_cycle(const truepose_model* model, truepose_start_test* test,
                                           const truepose_real* q_e, int32_t referenced,
                                           const truepose_knowledge* known, truepose_real* work,
                                           truepose_start_report* report) {
  return c::asked(model, [&](const Robot& robot) {
    c::Start* made = c::Start::of(test);
    if (made == nullptr) return c::kUnfinished;
    const c::Known by(robot, known, work);
    if (!by.sound) return by.sound;
    start_test(robot, made->settings, made->limits, c::values<Extended>(q_e), referenced != 0,
               made->test, by.weighing);
    const StartReport& now = made->test;
    *report = c::converted<truepose_start_report>(now);
    return Outcome{};
  });
}
}
