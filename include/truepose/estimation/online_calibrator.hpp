// Online calibration beside the control cycle.
//
// Between readings and torque, the online filter (online_calibration.hpp) updates ξ by this row of
// readings; from then on the controller uses the robot at ξ̂.
#pragma once

#include "truepose/estimation/online_calibration.hpp"
#include "truepose/full/linearise.hpp"

namespace truepose {
/// The online calibrator. Arrays that it points to are the caller's; `robot` is the controller's.
struct OnlineCalibrator {
  const Robot* drawn = nullptr;  ///< nominal robot, as for set_parameters
  OnlineSettings settings;
  OnlineState state;
  Real* work = nullptr;  ///< online_work(*drawn, state.count) numbers
  /// A row counts where a reading has moved by this many of its own σ since the last one: at rest
  /// every cycle has the same rounding error, which is no information.
  Real fresh = 30;
  Robot robot;
  Pose pose;          ///< x̂ of the last row, where the next one starts
  Extended last{};    ///< last row
  long lines = 0;     ///< rows used so far
  long left_out = 0;  ///< rows excluded as a whole (also for want of a pose) or by one reading
  Outcome made{};     ///< outcome of the last row

  Knowledge knowledge() const { return {state.count, state.column, state.root, state.sigma}; }
};

/// Runs one cycle. Bounded work, no allocation, no exception.
/// @return outcome of this row or, if it is no information, of the last one: only `ok` means that
/// all of it was used. `stopped` from the cycle in which the filter stops, with the last good robot
inline Outcome calibrate_online(Level level, OnlineCalibrator& learner, const Extended& q_e) {
  if (!learner.drawn->finished) return {Status::unfinished, -1};
  const int rows = dof(learner.drawn->mobility) + learner.drawn->r;
  bool news = learner.lines + learner.left_out == 0;
  for (int c = 0; c < rows; ++c)
    news = news || std::fabs(q_e[c] - learner.last[c]) > learner.fresh * learner.state.sigma[c];
  if (learner.state.doubt.stopped) return {Status::stopped, -1};
  if (!news) return learner.made;
  const Pose before = learner.pose;
  const Outcome outcome = observe(level, *learner.drawn, learner.settings, q_e, learner.state,
                                            learner.robot, learner.pose, learner.work);
  const Outcome believed = set_parameters(*learner.drawn, learner.state.xi, learner.robot);
  if (!believed) return believed;
  if (outcome.status == Status::disagree && outcome.chain < 0) learner.pose = before;
  if (outcome.status != Status::not_finite) {  // a bad row, too, counts once
    learner.last = q_e;
    learner.made = outcome;
  }
  ++(outcome.status == Status::ok ? learner.lines : learner.left_out);
  return outcome;
}

/// The same at the robot's own level.
inline Outcome calibrate_online(OnlineCalibrator& learner, const Extended& q_e) {
  return calibrate_online(level_of(*learner.drawn), learner, q_e);
}

/// Rolls back to before the latest rows (online_calibration.hpp saves that state, with a gate), for
/// a reading found faulty only after its fault began.
inline Outcome roll_back(OnlineCalibrator& learner) {
  OnlineState& state = learner.state;
  if (!state.kept || state.doubt.lines == 0) return {};
  online_detail::copy_state(state, true);
  state.doubt.evidence = 0;
  state.doubt.blame = {};
  state.doubt.since = 0;
  return set_parameters(*learner.drawn, state.xi, learner.robot);
}
}  // namespace truepose
