// What does Python's online self-calibration own? The filter's arrays, between one run and the
// next.
#pragma once

#include <vector>

#include "known.hpp"
#include "truepose/learning.hpp"

namespace truepose::python {

class Online {
 public:
  /// @param drift  one row for each random walk, one column for each uncertain parameter
  Online(const Robot& drawn, const Known& prior, std::vector<double> mean, RowMatrix drift,
         double gate, bool full)
      : drawn_(drawn),
        known_(prior),
        xi_(std::move(mean)),
        drift_(std::move(drift)),
        work_(online_work(drawn, static_cast<int>(prior.column.size()))),
        gate_(gate),
        full_(full) {}

  /// A learner that works on these arrays, believing `nominal` until its first line.
  Learner learner(const Robot& nominal) {
    Learner learner;
    learner.drawn = &drawn_;
    learner.settings.drifts = static_cast<int>(drift_.rows());
    learner.settings.drift = drift_.data();
    learner.settings.gate = gate_;
    learner.state = {static_cast<int>(known_.column.size()),
                     known_.column.data(),
                     xi_.data(),
                     known_.root.data(),
                     known_.sigma,
                     due_};
    learner.work = work_.data();
    learner.robot = nominal;
    learner.robot.level = drawn_.level;
    learner.pose = with_mobility(nominal.mobility,
                                 [&](auto mobility) { return to_pose<mobility()>(nominal.home); });
    return learner;
  }
  /// Goes on where another one was left, with its arrays.
  void resume(int due, long lines) { due_ = due, lines_ = lines; }

  /// Remembers what is not in the arrays.
  void take(const Learner& learner) {
    due_ = learner.state.due;
    lines_ += learner.lines;
  }

  const Robot& drawn() const { return drawn_; }
  bool full() const { return full_; }
  int due() const { return due_; }
  long lines() const { return lines_; }
  std::vector<double> xi() const { return xi_; }
  RowMatrix root() const { return known_.root; }

 private:
  Robot drawn_;
  Known known_;
  std::vector<double> xi_;
  RowMatrix drift_;
  std::vector<double> work_;
  double gate_;
  int due_ = 0;
  long lines_ = 0;
  bool full_;
};

/// A learner at work; what it has learnt is remembered however the work ends.
struct Lesson {
  Online& online;
  Learner learner;

  Lesson(Online& of, const Robot& nominal) : online(of), learner(of.learner(nominal)) {}
  ~Lesson() { online.take(learner); }
  Lesson(const Lesson&) = delete;
  Lesson& operator=(const Lesson&) = delete;
};

}  // namespace truepose::python
