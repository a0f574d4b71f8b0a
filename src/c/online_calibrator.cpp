// Estimation and online calibration for C.
#include "c/model.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
struct Pupil : InMemory<truepose_online_calibrator, Pupil, 0x6c697075U> {
  OnlineCalibrator learner;
};

/// Size of the memory in numbers: ξ̂, S, rollback state and work space.
std::size_t memory(const Robot& robot, std::int32_t count) {
  const std::size_t p = static_cast<std::size_t>(count);
  return static_cast<std::size_t>(parameter_count(robot)) + p * p +
         static_cast<std::size_t>(online_kept(count)) +
         static_cast<std::size_t>(online_work(robot, count));
}

Estimate estimated(const Robot& robot, const Known& known, const truepose_real* q_e,
                   truepose_real* work, truepose_real* x) {
  if (!known.sound) return {known.sound};
  if (!known.weighing) return {{Status::not_measured, -1}};
  Pose pose = to_pose(robot.mobility, values<Coordinates>(x));
  const Estimate found =
      estimate(level_of(robot), robot, known.knowledge, values<Extended>(q_e), pose, work);
  if (found) give(to_coordinates(robot.mobility, pose), x);
  return found;
}

Outcome begin(const Robot& drawn, const truepose_knowledge& prior, truepose_real* memory,
              OnlineCalibrator& learner) {
  if (drawn.r == 0) return {Status::not_measured, -1};
  Outcome outcome = columns_exist(drawn, prior, 1);
  if (!outcome) return outcome;
  const int p = prior.count;
  Real *xi = memory, *root = xi + parameter_count(drawn), *kept = root + p * p;
  outcome = drawn_parameters(drawn, xi);
  if (!outcome) return outcome;
  std::copy_n(prior.root, p * p, root);
  learner.drawn = &drawn;
  learner.state = {p, prior.column, xi, root, values<Extended>(prior.sigma), 0, kept, {}};
  learner.work = kept + online_kept(p);
  learner.robot = drawn;
  learner.pose = to_pose(drawn.mobility, drawn.home);
  return {};
}

/// f(calibrator) of an initialised one.
template <class Opaque, class F>
truepose_outcome taught(Opaque* learner, F&& f) {
  auto* made = Pupil::of(learner);
  return answer(made != nullptr ? f(made->learner) : kUnfinished);
}
}  // namespace
}  // namespace truepose::c

extern "C" {
truepose_estimate_result truepose_estimate(const truepose_model* model,
                                           const truepose_knowledge* known,
                                           const truepose_real* q_e, truepose_real* work,
                                           truepose_real* x) {
  const Robot* robot = c::robot_of(model);
  return c::converted<truepose_estimate_result>(
      robot ? c::estimated(*robot, c::Known(*robot, known, work), q_e, work, x)
            : Estimate{c::kUnfinished});
}

size_t truepose_online_calibrator_size(void) { return sizeof(c::Pupil); }

size_t truepose_online_calibrator_memory(const truepose_model* drawn, int32_t count) {
  const Robot* robot = c::robot_of(drawn);
  return robot && count >= 1 ? c::memory(*robot, count) : 0;
}

truepose_outcome truepose_online_calibrator_init(truepose_online_calibrator* learner, size_t size,
                                                 const truepose_model* drawn,
                                                 const truepose_knowledge* prior,
                                                 truepose_real* memory, size_t count) {
  return c::asked(drawn, [&](const Robot& robot) -> Outcome {
    c::Pupil* made = c::Pupil::make(learner, size);
    if (made == nullptr) return c::kTooSmall;
    made->mark = 0;  // invalid until initialised
    if (prior->count >= 1 && count < c::memory(robot, prior->count)) return c::kTooSmall;
    const Outcome outcome = c::begin(robot, *prior, memory, made->learner);
    if (outcome) made->mark = c::Pupil{}.mark;
    return outcome;
  });
}

truepose_outcome truepose_online_calibrator_step(truepose_online_calibrator* learner,
                                                 const truepose_real* q_e) {
  return c::taught(learner, [&](OnlineCalibrator& of) {
    return calibrate_online(of, c::values<Extended>(q_e));
  });
}

truepose_outcome truepose_online_calibrator_samples(const truepose_online_calibrator* learner,
                                                    int64_t* learnt, int64_t* left_out) {
  return c::taught(learner, [&](const OnlineCalibrator& of) -> Outcome {
    *learnt = of.lines;
    *left_out = of.left_out;
    return {};
  });
}

truepose_outcome truepose_online_calibrator_roll_back(truepose_online_calibrator* learner) {
  return c::taught(learner, [](OnlineCalibrator& of) { return roll_back(of); });
}

truepose_outcome truepose_online_calibrator_model(const truepose_online_calibrator* learner,
                                                  truepose_model* model, size_t size) {
  return c::taught(learner, [&](const OnlineCalibrator& of) -> Outcome {
    c::Model* out = c::Model::make(model, size);
    if (out == nullptr) return c::kTooSmall;
    out->robot = of.robot;
    return {};
  });
}

truepose_outcome truepose_online_calibrator_knowledge(const truepose_online_calibrator* learner,
                                                      truepose_knowledge* known) {
  return c::taught(learner, [&](const OnlineCalibrator& of) -> Outcome {
    *known = c::converted<truepose_knowledge>(of.knowledge());
    return {};
  });
}
}
