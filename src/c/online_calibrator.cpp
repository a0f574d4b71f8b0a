// Estimation and online calibration for C.
#include "c/model.hpp"

using namespace truepose;

namespace truepose::c {
template <>
struct Held<truepose_online_calibrator> : InMemory<truepose_online_calibrator, 0x6c697075U> {
  OnlineCalibrator calibrator;
  Window window;
};
using Calibrator = Held<truepose_online_calibrator>;

namespace {
Outcome begin(const Robot& drawn, const truepose_knowledge& prior, truepose_real* memory,
              OnlineCalibrator& calibrator) {
  if (drawn.r == 0) return Status::not_measured;
  const Outcome outcome = columns_exist(drawn, prior, 1);
  return outcome ? start(drawn, in<Knowledge>(&prior), memory, calibrator) : outcome;
}

static_assert(kNews == TRUEPOSE_RECOGNISED && int(ChangeKind::unexplained) == TRUEPOSE_UNEXPLAINED);

/// Whether every step belongs to a change, and the payload's is one of them.
bool sound(const ChangeSettings& changes) {
  if (changes.count < 1 || changes.drifts < 0) return false;
  bool good = changes.load >= -1 && changes.load < changes.steps;
  for (int k : range(changes.count))
    good = good && changes.end[k] > (k > 0 ? changes.end[k - 1] : 0);
  return good && changes.end[changes.count - 1] == changes.steps;
}
}  // namespace
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
truepose_estimate_result truepose_estimate(const truepose_model* model,
                                           const truepose_knowledge* known,
                                           const truepose_real* q_e, truepose_real* work,
                                           truepose_real* x) {
  return with(model, Both{x})([&](const Robot& robot, Coordinates& found) {
    const Known by(robot, known, work);
    if (!by.sound) return Estimate{by.sound};
    if (!by.weighing) return Estimate{{Status::not_measured}};
    Pose pose = to_pose(robot.mobility, found);
    const Estimate result =
        estimate(level_of(robot), robot, by.knowledge, in<Extended>(q_e), pose, work);
    found = to_coordinates(robot.mobility, pose);
    return result;
  });
}

size_t truepose_online_calibrator_size(void) { return sizeof(Calibrator); }

size_t truepose_online_calibrator_memory(const truepose_model* drawn, int32_t count) {
  const Robot* robot = held(drawn);
  return robot && count >= 1 ? static_cast<size_t>(online_memory(*robot, count)) : 0;
}

truepose_outcome truepose_online_calibrator_init(truepose_online_calibrator* calibrator,
                                                 size_t size, const truepose_model* drawn,
                                                 const truepose_knowledge* prior,
                                                 truepose_real* memory, size_t count) {
  return with(drawn)([&](const Robot& robot) {
    return begun({}, calibrator, size, [&](Calibrator& made) {
      const bool fits =
          prior->count < 1 || count >= truepose_online_calibrator_memory(drawn, prior->count);
      return fits ? begin(robot, *prior, memory, made.calibrator) : kTooSmall;
    });
  });
}

truepose_outcome truepose_online_calibrator_step(truepose_online_calibrator* calibrator,
                                                 const truepose_real* q_e) {
  return with(calibrator, q_e)(
      [](Calibrator& of, const Extended& read) { return calibrate_online(of.calibrator, read); });
}

truepose_outcome truepose_online_calibrator_samples(const truepose_online_calibrator* calibrator,
                                                    int64_t* used, int64_t* left_out) {
  return with(calibrator)([&](const Calibrator& of) {
    *used = of.calibrator.lines;
    *left_out = of.calibrator.left_out;
  });
}

truepose_outcome truepose_online_calibrator_roll_back(truepose_online_calibrator* calibrator) {
  return with(calibrator)([](Calibrator& of) { return roll_back(of.calibrator); });
}

size_t truepose_online_calibrator_follow_memory(const truepose_online_calibrator* calibrator,
                                                const truepose_changes* changes) {
  const Calibrator* of = held(calibrator);
  const auto core = in<ChangeSettings>(changes);
  return of && sound(core) ? static_cast<size_t>(follow_memory(of->calibrator, core)) : 0;
}

truepose_outcome truepose_online_calibrator_follow(truepose_online_calibrator* calibrator,
                                                   const truepose_changes* changes,
                                                   truepose_real* memory, size_t count) {
  return with(calibrator, changes)([&](Calibrator& of, const ChangeSettings& core) -> Outcome {
    if (!sound(core)) return Status::no_such_value;
    if (count < truepose_online_calibrator_follow_memory(calibrator, changes)) return kTooSmall;
    follow(core, memory, of.window, of.calibrator);
    return {};
  });
}

truepose_outcome truepose_online_calibrator_changes(const truepose_online_calibrator* calibrator,
                                                    int64_t* count, truepose_recognised* latest) {
  return with(calibrator)([&](const Calibrator& of) {
    *count = of.window.recognised;
    for (const auto& [row, kind, which, log_odds] : of.window.news)
      *latest++ = {row, std::int32_t(kind), which, log_odds};
  });
}

truepose_outcome truepose_online_calibrator_model(const truepose_online_calibrator* calibrator,
                                                  truepose_model* model, size_t size) {
  return with(calibrator)([&](const Calibrator& of) {
    return begun({}, model, size, [&](Model& made) { made.robot = of.calibrator.robot; });
  });
}

truepose_outcome truepose_online_calibrator_knowledge(const truepose_online_calibrator* calibrator,
                                                      truepose_knowledge* known) {
  return with(calibrator)([&](const Calibrator& of) { out(of.calibrator.knowledge(), known); });
}
}
