// Online calibration beside the control cycle.
//
// Between a cycle's readings and its torque, the online filter (online_calibration.hpp) takes the
// readings as one more line about ξ, and the controller believes in the robot at ξ̂ from then on.
#pragma once

#include "truepose/estimation/online_calibration.hpp"
#include "truepose/full/linearise.hpp"

namespace truepose {

/// Online self-calibration switched on. The arrays that it points to are the caller's; `robot` is
/// what the controller believes.
struct OnlineCalibrator {
  const Robot* drawn = nullptr;  ///< as set_parameters takes it
  OnlineSettings settings;
  OnlineState state;
  Real* work = nullptr;  ///< online_work(*drawn, state.count) numbers
  /// A line counts where a reading has moved by so many of its own σ since the last one: in a robot
  /// at rest the same fraction of a count is lost in every cycle, and is no news.
  Real fresh = 30;
  Robot robot;
  Pose pose;          ///< x̂ of the last line, from which the next one starts
  Extended last{};    ///< the last line
  long lines = 0;     ///< learnt so far
  long left_out = 0;  ///< that fitted no pose, or not each other: all of the line, or one reading
  Outcome made{};     ///< what the filter made of the last line

  Knowledge knowledge() const { return {state.count, state.column, state.root, state.sigma}; }
};

/// One cycle. Bounded work, no allocation, no exception.
/// @return what the filter made of the readings, or, where they are no news, of the last line: only
/// `ok` says that all of it was learnt from. `stopped` from the cycle on in which it gave up: the
/// robot is then the last good one
template <Mobility K, class Model>
inline Outcome calibrate_online(OnlineCalibrator& learner, const Extended& q_e) {
  if (!learner.drawn->finished) return {Status::unfinished, -1};
  const int rows = kDof<K> + learner.drawn->r;
  bool news = learner.lines + learner.left_out == 0;
  for (int c = 0; c < rows; ++c)
    news = news || std::fabs(q_e[c] - learner.last[c]) > learner.fresh * learner.state.sigma[c];
  if (learner.state.doubt.stopped) return {Status::stopped, -1};
  if (!news) return learner.made;
  const Pose before = learner.pose;
  const Outcome outcome = observe<K, Model>(*learner.drawn, learner.settings, q_e, learner.state,
                                            learner.robot, learner.pose, learner.work);
  const Outcome believed = set_parameters(*learner.drawn, learner.state.xi, learner.robot);
  if (!believed) return believed;
  if (outcome.status == Status::disagree && outcome.chain < 0) learner.pose = before;
  if (outcome.status != Status::not_finite) {  // also a bad line is no news twice
    learner.last = q_e;
    learner.made = outcome;
  }
  ++(outcome.status == Status::ok ? learner.lines : learner.left_out);
  return outcome;
}

/// The same at the level at which the robot is understood.
template <Mobility K>
Outcome calibrate_online(OnlineCalibrator& learner, const Extended& q_e) {
  if constexpr (kRodByRod<K>)
    if (learner.drawn->rod_by_rod()) return calibrate_online<K, FullModel>(learner, q_e);
  return calibrate_online<K, IdealModel>(learner, q_e);
}

/// Goes back to before the latest lines (online_calibration.hpp keeps what it was, where it is
/// gated): one of their readings has been found to lie, later than it began to.
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
