// Python's online calibration: the filter's arrays, kept between runs.
#pragma once

#include <algorithm>
#include <type_traits>
#include <vector>

#include "estimation/online_calibrator.hpp"
#include "python/known.hpp"

namespace truepose::python {
/// An online calibrator, the arrays that it points to, and their level.
class Online {
 public:
  /// @param drift  one row per random walk, one column per uncertain parameter
  Online(const Robot& drawn, const Known& prior, std::vector<double> mean, RowMatrix drift,
         double gate, bool full)
      : drawn_(drawn), known_(prior), xi_(std::move(mean)), drift_(std::move(drift)), full_(full) {
    const int count = static_cast<int>(known_.column.size());
    work_.resize(online_work(drawn, count));
    kept_.resize(online_kept(count));
    learner_.drawn = &drawn_;
    learner_.settings = {static_cast<int>(drift_.rows()), drift_.data(), nullptr, gate};
    learner_.state = {count, known_.column.data(), xi_.data(), known_.root.data(), known_.sigma,
                      0,     kept_.data(),         {}};
    learner_.work = work_.data();
  }
  Online(const Online&) = delete;
  Online& operator=(const Online&) = delete;

  /// The calibrator for a run: with the robot at ξ̂. Its first row is new.
  OnlineCalibrator& begin(const Robot& nominal) {
    learner_.settings.linearised = nullptr;
    learner_.robot = nominal;
    learner_.robot.level = drawn_.level;
    static_cast<void>(set_parameters(drawn_, xi_.data(), learner_.robot));
    learner_.pose = to_pose(nominal.mobility, nominal.home);
    learner_.last.fill(INFINITY);
    return learner_;
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

  const Robot& drawn() const { return drawn_; }
  bool full() const { return full_; }
  const OnlineCalibrator& learner() const { return learner_; }
  const ResidualTest& doubt() const { return learner_.state.doubt; }
  std::vector<double> xi() const { return xi_; }
  RowMatrix root() const { return known_.root; }

 private:
  template <class Self, class F>
  static void each_number(Self& self, F&& f) {
    auto& state = self.learner_.state;
    f(state.due), f(self.learner_.lines), f(self.learner_.left_out);
    f(state.doubt.evidence), f(state.doubt.stopped), f(state.doubt.suspect), f(state.doubt.lines);
    f(state.doubt.since);
    std::for_each(state.doubt.blame.begin(), state.doubt.blame.end(), f);
    std::for_each(self.kept_.begin(), self.kept_.end(), f);
  }

  Robot drawn_;
  Known known_;
  std::vector<double> xi_;
  RowMatrix drift_;
  bool full_;
  std::vector<double> work_, kept_;
  OnlineCalibrator learner_;
};
}  // namespace truepose::python
