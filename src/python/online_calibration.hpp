// Python's online calibration: the filter's arrays, kept between runs.
#pragma once

#include <vector>

#include "estimation/online_calibrator.hpp"
#include "python/known.hpp"

namespace truepose::python {
/// An online calibrator, the arrays that it points to, and their level.
struct Online : OnlineCalibrator {
  const Robot nominal;
  Known known;
  std::vector<double> xi;
  const RowMatrix drifts;
  const Level level;
  std::vector<double> space, kept;

  /// @param drift  one row per random walk, one column per uncertain parameter
  Online(const Robot& of, const Known& prior, std::vector<double> mean, RowMatrix drift,
         double gate, bool full)
      : nominal(of),
        known(prior),
        xi(std::move(mean)),
        drifts(std::move(drift)),
        level(python::level(full)) {
    const int count = static_cast<int>(known.column.size());
    space.resize(online_work(nominal, count));
    kept.resize(online_kept(count));
    drawn = &nominal;
    settings = {drifts.rows(), drifts.data(), nullptr, gate};
    state = {count, known.column.data(), xi.data(), known.root.data(), known.sigma,
             0,     kept.data(),         {}};
    work = space.data();
  }
  Online(const Online&) = delete;
  Online& operator=(const Online&) = delete;

  /// The calibrator for a run: with the robot at ξ̂. Its first row is new.
  OnlineCalibrator& begin(const Robot& of) {
    settings.linearised = nullptr;
    robot = of;
    robot.level = nominal.level;
    static_cast<void>(set_parameters(nominal, xi.data(), robot));
    pose = to_pose(of.mobility, of.home);
    last.fill(INFINITY);
    return *this;
  }
  /// State other than ξ̂ and its root: the rollback state, counts, and the residual test.
  nb::tuple memory() const {
    return nb::make_tuple(kept, state.due, lines, left_out,
                          nb::bytes(&state.doubt, sizeof state.doubt));
  }
  /// Resumes from another object's arrays and memory.
  void resume(const std::vector<double>& saved, int due, long used, long excluded,
              const nb::bytes& doubt) {
    if (saved.size() != kept.size() || doubt.size() != sizeof state.doubt)
      throw std::invalid_argument("the memory of another filter");
    std::copy(saved.begin(), saved.end(), kept.begin());
    state.due = due, lines = used, left_out = excluded;
    std::memcpy(&state.doubt, doubt.data(), doubt.size());
  }
};
}  // namespace truepose::python
