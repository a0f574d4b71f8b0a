// Online calibration beside the control cycle.
#include "estimation/online_calibrator.hpp"

namespace truepose {
Outcome calibrate_online(Level level, OnlineCalibrator& learner, const Extended& q_e) {
  if (!learner.drawn->finished) return {Status::unfinished, -1};
  const int rows = readings(*learner.drawn);
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

Outcome roll_back(OnlineCalibrator& learner) {
  OnlineState& state = learner.state;
  if (!state.kept || state.doubt.lines == 0) return {};
  online_detail::copy_state(state, true);
  state.doubt.evidence = 0;
  state.doubt.blame = {};
  state.doubt.since = 0;
  return set_parameters(*learner.drawn, state.xi, learner.robot);
}
}  // namespace truepose
