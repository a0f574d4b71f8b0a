// Python's online calibration: the filter's arrays, kept between runs.
#pragma once

#include <vector>

#include "known.hpp"
#include "truepose/estimation/online_calibrator.hpp"

namespace truepose::python {

class Online {
 public:
  /// @param drift  one row per random walk, one column per uncertain parameter
  Online(const Robot& drawn, const Known& prior, std::vector<double> mean, RowMatrix drift,
         double gate, bool full)
      : drawn_(drawn),
        known_(prior),
        xi_(std::move(mean)),
        drift_(std::move(drift)),
        work_(online_work(drawn, static_cast<int>(prior.column.size()))),
        kept_(online_kept(static_cast<int>(prior.column.size()))),
        gate_(gate),
        full_(full) {}

  /// A calibrator on these arrays, with the robot `nominal` until its first row.
  OnlineCalibrator learner(const Robot& nominal) {
    OnlineCalibrator learner;
    learner.drawn = &drawn_;
    learner.settings.drifts = static_cast<int>(drift_.rows());
    learner.settings.drift = drift_.data();
    learner.settings.gate = gate_;
    learner.state = {static_cast<int>(known_.column.size()),
                     known_.column.data(),
                     xi_.data(),
                     known_.root.data(),
                     known_.sigma,
                     due_,
                     kept_.data(),
                     doubt_};
    learner.work = work_.data();
    learner.robot = nominal;
    learner.robot.level = drawn_.level;
    learner.pose = to_pose(nominal.mobility, nominal.home);
    return learner;
  }
  /// State other than ξ̂ and its root: counts, the residual test and the rollback state.
  std::vector<double> memory() const {
    std::vector<double> all{double(due_),         double(lines_),         double(left_out_),
                            doubt_.evidence,      double(doubt_.stopped), double(doubt_.suspect),
                            double(doubt_.lines), double(doubt_.since)};
    all.insert(all.end(), doubt_.blame.begin(), doubt_.blame.end());
    all.insert(all.end(), kept_.begin(), kept_.end());
    return all;
  }
  /// Resumes from another object's arrays and memory.
  void resume(const std::vector<double>& all) {
    const std::size_t counts = 8, blames = doubt_.blame.size();
    if (all.size() != counts + blames + kept_.size())
      throw std::invalid_argument("the memory of another filter");
    due_ = int(all[0]), lines_ = long(all[1]), left_out_ = long(all[2]);
    doubt_.evidence = all[3], doubt_.stopped = all[4] != 0, doubt_.suspect = int(all[5]);
    doubt_.lines = long(all[6]), doubt_.since = int(all[7]);
    std::copy_n(all.begin() + counts, blames, doubt_.blame.begin());
    std::copy_n(all.begin() + counts + blames, kept_.size(), kept_.begin());
  }

  /// Stores the state that is not in the arrays.
  void take(const OnlineCalibrator& learner) {
    due_ = learner.state.due;
    doubt_ = learner.state.doubt;
    lines_ += learner.lines;
    left_out_ += learner.left_out;
  }

  const Robot& drawn() const { return drawn_; }
  bool full() const { return full_; }
  long lines() const { return lines_; }
  long left_out() const { return left_out_; }
  const ResidualTest& doubt() const { return doubt_; }
  std::vector<double> xi() const { return xi_; }
  RowMatrix root() const { return known_.root; }

 private:
  Robot drawn_;
  Known known_;
  std::vector<double> xi_;
  RowMatrix drift_;
  std::vector<double> work_, kept_;
  double gate_;
  int due_ = 0;
  ResidualTest doubt_;
  long lines_ = 0, left_out_ = 0;
  bool full_;
};

/// A running calibrator, whose state is stored however the run ends.
struct Lesson {
  Online& online;
  OnlineCalibrator learner;

  Lesson(Online& of, const Robot& nominal) : online(of), learner(of.learner(nominal)) {}
  ~Lesson() { online.take(learner); }
  Lesson(const Lesson&) = delete;
  Lesson& operator=(const Lesson&) = delete;
};

}  // namespace truepose::python
