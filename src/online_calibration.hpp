// Python's online calibration: the filter's arrays, kept between runs.
#pragma once

#include <algorithm>
#include <type_traits>
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
    std::vector<double> all;
    each_number(*this, [&](const auto& number) { all.push_back(static_cast<double>(number)); });
    return all;
  }
  /// Resumes from another object's arrays and memory.
  void resume(const std::vector<double>& all) {
    if (all.size() != memory().size()) throw std::invalid_argument("the memory of another filter");
    auto next = all.begin();
    each_number(*this, [&](auto& number) {
      number = static_cast<std::remove_reference_t<decltype(number)>>(*next++);
    });
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
  template <class Self, class F>
  static void each_number(Self& self, F&& f) {
    auto& doubt = self.doubt_;
    f(self.due_), f(self.lines_), f(self.left_out_);
    f(doubt.evidence), f(doubt.stopped), f(doubt.suspect), f(doubt.lines), f(doubt.since);
    std::for_each(doubt.blame.begin(), doubt.blame.end(), f);
    std::for_each(self.kept_.begin(), self.kept_.end(), f);
  }

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
