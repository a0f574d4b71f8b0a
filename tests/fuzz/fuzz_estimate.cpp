// Does any robot, knowledge or reading make an estimate or the learner crash, hang, call a NaN an
// answer, or spoil what it had learnt?
#include "decode.hpp"
#include "estimation/linearise.hpp"
#include "estimation/online_calibrator.hpp"

namespace {

using namespace fuzz;

/// Readings of a pose, perhaps with one spoilt, or any numbers.
Extended decode_readings(Bytes& bytes, const Subject& subject) {
  const Mobility K = subject.robot.mobility;
  const int rows = readings(subject.robot);
  Extended q_e{};
  if (!extended(Level::ideal, subject.robot, to_pose(K, decode_pose(bytes, subject)), q_e) ||
      bytes.one_in(6))
    for (int c = 0; c < rows; ++c) q_e[c] = bytes.number();
  if (bytes.one_in(4)) q_e[bytes.below(rows)] = bytes.number();
  return q_e;
}

void check_estimate(Level level, Bytes& bytes, const Subject& subject, mechanisms::Prior& prior) {
  const Extended q_e = decode_readings(bytes, subject);
  const Mobility K = subject.robot.mobility;
  Pose pose = to_pose(K, decode_pose(bytes, subject));
  const Estimate result =
      estimate(level, subject.robot, prior.known(), q_e, pose, prior.weighing().work);
  require(result.iterations <= kEstimateIterations + 1, "estimate: iterations are bounded");
  if (!result) return;
  require(pose.D.allFinite() && pose.R.allFinite(), "estimate: ok is finite");
  require(finite(result.covariance, dof(K), dof(K)), "estimate: the covariance is finite");
  for (int i = 0; i < dof(K); ++i)
    require(result.covariance[i][i] >= 0, "estimate: no variance is negative");
  require(result.chi2 >= 0 && std::isfinite(result.chi2), "estimate: χ² is a number from 0 up");
}

void check_learner(Level level, Bytes& bytes, const Subject& subject, mechanisms::Prior& prior) {
  OnlineCalibrator learner = prior.learner(subject.robot);
  if (bytes.one_in(2)) learner.settings.gate = std::fabs(bytes.number());
  if (bytes.one_in(4)) learner.fresh = bytes.number();
  const int p = learner.state.count, width = parameter_count(subject.robot);
  const auto all = [](const double* values, int count) {
    return std::vector<double>(values, values + count);
  };
  if (!all_finite(all(learner.state.xi, width), width)) return;  // drawn so
  for (int cycle = 0; cycle < 6; ++cycle) {
    const std::vector<double> xi = all(learner.state.xi, width),
                              root = all(learner.state.root, p * p);
    const long lines = learner.lines;
    const bool gave_up = learner.state.test.stopped;
    const Outcome outcome = calibrate_online(level, learner, decode_readings(bytes, subject));
    // It learns from a line less the reading that it blames; where it gives up, it goes back.
    const bool blames = outcome.status == Status::disagree && outcome.chain >= 0;
    const bool gives_up = learner.state.test.stopped != gave_up;
    if ((!outcome || learner.lines == lines) && !blames && !gives_up)
      require(xi == all(learner.state.xi, width) && root == all(learner.state.root, p * p),
              "learner: a line that is left out changes nothing");
    require(all_finite(all(learner.state.xi, width), width), "learner: ξ is finite");
    require(all_finite(all(learner.state.root, p * p), p * p), "learner: its covariance is finite");
  }
}

void check_follower(Level level, Bytes& bytes, const Subject& subject, mechanisms::Prior& prior) {
  OnlineCalibrator follower = prior.follower(subject.robot);
  const int p = follower.state.count, width = parameter_count(subject.robot);
  if (!all_finite(follower.state.xi, width)) return;  // drawn so
  const Extended first = decode_readings(bytes, subject);
  for (int cycle = 0; cycle < 60; ++cycle) {
    Extended q_e = first;
    q_e[cycle % readings(subject.robot)] += cycle % 7 ? 1e-3 * cycle : bytes.number();
    static_cast<void>(calibrate_online(level, follower, q_e));
    require(all_finite(follower.state.xi, width), "follower: ξ is finite");
    require(all_finite(follower.state.root, p * p), "follower: its covariance is finite");
  }
}

void check_level(Level level, Bytes& bytes, const Subject& subject) {
  mechanisms::Prior prior(subject.robot);
  if (bytes.one_in(4)) prior.known().sigma[bytes.below(kMaxReadings)] = bytes.number();
  check_estimate(level, bytes, subject, prior);
  check_learner(level, bytes, subject, prior);
  mechanisms::Prior again(subject.robot);
  if (bytes.one_in(8)) check_follower(level, bytes, subject, again);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  const bool full = bytes.one_in(2);
  const Subject subject = decode_robot(bytes);
  check_level(full && paired(subject.robot.mobility) ? Level::full : Level::ideal, bytes, subject);
  return 0;
}
