// The start-up test for C.
#include "c/controllers.hpp"
#include "safety/fields.hpp"
#include "safety/start_test.hpp"

using namespace truepose;

namespace truepose::c {
template <>
struct Held<truepose_start_test> : InMemory<truepose_start_test, 0x74726153U> {
  StartSettings settings;
  SafetyLimits limits;
  StartTest test;
};
using Start = Held<truepose_start_test>;
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
const char* truepose_start_finding_text(int32_t finding) {
  const auto at = static_cast<std::size_t>(finding);
  return at < kStartFindings.size() ? kStartFindings[at] : "";
}

void truepose_start_defaults(truepose_start_settings* settings) { out(StartSettings{}, settings); }

size_t truepose_start_test_size(void) { return sizeof(Start); }

truepose_outcome truepose_start_test_init(truepose_start_test* test, size_t size,
                                          const truepose_model* model,
                                          const truepose_start_settings* settings,
                                          const truepose_safety_limits* limits) {
  return with(model)([&](const Robot& robot) {
    SafetyLimits all;
    Outcome sound = take(*limits, all);
    if (settings && settings->size != sizeof *settings) sound = {Status::other_version};
    if (sound && overdriven(robot)) sound = {Status::not_square};  // locked by the others' brakes
    if (sound) sound = consistent(all, robot.motors, dof(robot.mobility));
    return begun(sound, test, size, [&](Start& made) {
      made.limits = all;
      if (settings) made.settings = in<StartSettings>(settings);
    });
  });
}

truepose_outcome truepose_start_test_cycle(const truepose_model* model, truepose_start_test* test,
                                           const truepose_real* q_e, int32_t referenced,
                                           const truepose_knowledge* known, truepose_real* work,
                                           truepose_start_report* report) {
  return with(model, test)([&](const Robot& robot, Start& made) {
    const Known by(robot, known, work);
    if (!by.sound) return by.sound;
    start_test(robot, made.settings, made.limits, in<Extended>(q_e), referenced != 0, made.test,
               by.weighing);
    out<StartReport>(made.test, report);
    return Outcome{};
  });
}
}
