// Estimation and online calibration for C.
#include "c/model.hpp"

using namespace truepose;

namespace truepose::c {
template <>
struct Held<truepose_online_calibrator> : InMemory<truepose_online_calibrator, 0x6c697075U> {
  OnlineCalibrator learner;
  Window window;
};
using Pupil = Held<truepose_online_calibrator>;

namespace {
/// Size of the memory in numbers: ξ̂, S, rollback state and work space.
std::size_t memory_of(const Robot& robot, std::int32_t count) {
  const std::size_t p = static_cast<std::size_t>(count);
  return static_cast<std::size_t>(parameter_count(robot)) + p * p +
         static_cast<std::size_t>(online_kept(count)) +
         static_cast<std::size_t>(online_work(robot, count));
}

Outcome begin(const Robot& drawn, const truepose_knowledge& prior, truepose_real* memory,
              OnlineCalibrator& learner) {
  if (drawn.r == 0) return {Status::not_measured};
  Outcome outcome = columns_exist(drawn, prior, 1);
  if (!outcome) return outcome;
  const int p = prior.count;
  Real *xi = memory, *root = xi + parameter_count(drawn), *kept = root + p * p;
  outcome = drawn_parameters(drawn, xi);
  if (!outcome) return outcome;
  std::copy_n(prior.root, p * p, root);
  learner.drawn = &drawn;
  learner.state = {p, prior.column, xi, root, in<Extended>(prior.sigma), 0, kept, {}};
  learner.work = kept + online_kept(p);
  learner.robot = drawn;
  learner.pose = to_pose(drawn.mobility, drawn.home);
  return {};
}

static_assert(kNews == TRUEPOSE_RECOGNISED &&
              static_cast<int>(ChangeKind::unexplained) == TRUEPOSE_UNEXPLAINED);

/// Whether every step belongs to a change, and the payload's is one of them.
bool sound(const truepose_changes& changes) {
  if (changes.count < 1 || changes.drifts < 0) return false;
  bool good = changes.load >= -1 && changes.load < changes.steps;
  for (int k = 0; k < changes.count; ++k)
    good = good && changes.end[k] > (k > 0 ? changes.end[k - 1] : 0);
  return good && changes.end[changes.count - 1] == changes.steps;
}

ChangeSettings settings_of(const truepose_changes& changes) {
  return {changes.steps,
          changes.step,
          changes.count,
          changes.end,
          changes.log_odds,
          changes.load,
          in<Coordinates>(changes.force),
          in<Joint>(changes.compliance)};
}

std::size_t memory_of(const OnlineCalibrator& learner, const ChangeSettings& changes) {
  return static_cast<std::size_t>(window_memory(*learner.drawn, learner.state.count, changes) +
                                  parameter_count(*learner.drawn));
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

size_t truepose_online_calibrator_size(void) { return sizeof(Pupil); }

size_t truepose_online_calibrator_memory(const truepose_model* drawn, int32_t count) {
  const Robot* robot = held(drawn);
  return robot && count >= 1 ? memory_of(*robot, count) : 0;
}

truepose_outcome truepose_online_calibrator_init(truepose_online_calibrator* learner, size_t size,
                                                 const truepose_model* drawn,
                                                 const truepose_knowledge* prior,
                                                 truepose_real* memory, size_t count) {
  return with(drawn)([&](const Robot& robot) {
    return begun({}, learner, size, [&](Pupil& made) {
      const bool fits = prior->count < 1 || count >= memory_of(robot, prior->count);
      return fits ? begin(robot, *prior, memory, made.learner) : kTooSmall;
    });
  });
}

truepose_outcome truepose_online_calibrator_step(truepose_online_calibrator* learner,
                                                 const truepose_real* q_e) {
  return with(learner)([&](Pupil& of) { return calibrate_online(of.learner, in<Extended>(q_e)); });
}

truepose_outcome truepose_online_calibrator_samples(const truepose_online_calibrator* learner,
                                                    int64_t* learnt, int64_t* left_out) {
  return with(learner)([&](const Pupil& of) {
    *learnt = of.learner.lines;
    *left_out = of.learner.left_out;
  });
}

truepose_outcome truepose_online_calibrator_roll_back(truepose_online_calibrator* learner) {
  return with(learner)([](Pupil& of) { return roll_back(of.learner); });
}

size_t truepose_online_calibrator_follow_memory(const truepose_online_calibrator* learner,
                                                const truepose_changes* changes) {
  const Pupil* of = held(learner);
  return of && sound(*changes) ? memory_of(of->learner, settings_of(*changes)) : 0;
}

truepose_outcome truepose_online_calibrator_follow(truepose_online_calibrator* learner,
                                                   const truepose_changes* changes,
                                                   truepose_real* memory, size_t count) {
  return with(learner)([&](Pupil& of) -> Outcome {
    OnlineCalibrator& own = of.learner;
    if (!sound(*changes)) return {Status::no_such_value};
    const ChangeSettings settings = settings_of(*changes);
    if (count < memory_of(own, settings)) return kTooSmall;
    own.settings.changes = settings;
    own.settings.drifts = changes->drifts, own.settings.drift = changes->drift;
    own.in_use = memory;
    std::copy_n(own.state.xi, parameter_count(*own.drawn), own.in_use);
    of.window = {};
    lay_out(*own.drawn, own.state.count, settings, memory + parameter_count(*own.drawn), of.window);
    of.window.sigma = own.state.sigma;
    own.state.window = &of.window;
    return {};
  });
}

truepose_outcome truepose_online_calibrator_changes(const truepose_online_calibrator* learner,
                                                    int64_t* count, truepose_recognised* latest) {
  return with(learner)([&](const Pupil& of) {
    *count = of.window.recognised;
    for (const auto& [row, kind, which, log_odds] : of.window.news)
      *latest++ = {row, static_cast<std::int32_t>(kind), which, log_odds};
  });
}

truepose_outcome truepose_online_calibrator_model(const truepose_online_calibrator* learner,
                                                  truepose_model* model, size_t size) {
  return with(learner)([&](const Pupil& of) {
    return begun({}, model, size, [&](Model& made) { made.robot = of.learner.robot; });
  });
}

truepose_outcome truepose_online_calibrator_knowledge(const truepose_online_calibrator* learner,
                                                      truepose_knowledge* known) {
  return with(learner)([&](const Pupil& of) { out(of.learner.knowledge(), known); });
}
}
