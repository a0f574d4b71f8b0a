// Online (recursive) calibration, one row of readings per cycle.
//
// A square-root filter on ξ (root_filter.hpp). The unknown pose of each row is eliminated
// (row.hpp): r equations about ξ alone remain (with m > n motors m - n + r). Testing them together
// detects an error in any mixture of the readings: their χ² has r degrees of freedom. An error of
// one reading is one more column: allowing for it lowers χ² (evidence.hpp). No single row shows a
// small persistent fault: Page's CUSUM adds up how much likelier the rows are with twice the stated
// errors than with these (Page, Continuous Inspection Schemes, 1954). Bounded work, no allocation.
#pragma once

#include "estimation/changes.hpp"
#include "estimation/row.hpp"
#include "mechanism/geometry.hpp"

namespace truepose {
inline constexpr Real kVarianceRatio = 4;  ///< variance of disagreeing readings over the stated one
/// Largest contribution of a row: one gross row must not stop the filter, six in a row must.
inline constexpr Real kMostLogRatio = 3;
inline constexpr Real kThreshold = 16;  ///< at most one false stop in e¹⁶ clean rows (Lorden)
inline constexpr Real kIsolates = 2;    ///< rows more in which one reading is faulty than any other
inline constexpr int kSavePeriod = 4;   ///< rows between saved states

/// Disagreement of the readings of the last rows. Plain data.
struct ResidualTest {
  Real cusum = 0;        ///< log of the likelihood ratio since it was last 0
  Extended faulty{};     ///< rows since then in which each reading alone was faulty
  bool stopped = false;  ///< identification has stopped
  int suspect = -1;      ///< reading that explains it best; -1: not unique
  long lines = 0;        ///< rows until it stopped
  int since = 0;         ///< rows since a state was saved
};

/// State of the filter. The arrays are the caller's; it starts from the prior.
struct OnlineState : RootFilter {
  Extended sigma{};          ///< σ of every reading's own error, > 0
  int due = 0;               ///< index of the next drift
  RootFilter kept{};         ///< to roll back to
  ResidualTest test{};       ///< disagreement of the readings, and whether it stopped the filter
  Window* window = nullptr;  ///< evidence of changes; nullptr: none
};

/// Settings of the filter. Constant during a run.
struct OnlineSettings {
  const Real* linearised = nullptr;  ///< ξ about which to linearise (replay); nullptr: ξ̂ itself
  /// σ beyond which a row's equations together are rejected: the row is excluded, or the one
  /// reading that explains them. Persistent disagreement stops the filter. 0: every row counts.
  Real gate = kGate;
  ChangeSettings changes{};
};

/// Curvature of the readings, per m or rad: a few times one over a robot's lengths, since its
/// Jacobians multiply it. Chosen by trial on H4s: with 1 and with 8 one pass ends farther from the
/// batch than with 12.
inline constexpr Real kCurvature = 12;

/// Numbers of work space for `observe`.
inline int online_work(const Robot& robot, int count) {
  const int m = readings(robot), r = redundancy(robot);
  return m * (parameter_count(robot) + count) + m * m + (2 * r + 1) * count;
}

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
  /// ξ of `robot`, parameter_count values, which then approaches ξ̂: no motor's setpoint changes by
  /// more than kJump of its σ a cycle. nullptr: it is ξ̂
  Real* in_use = nullptr;
  Pose pose;          ///< x̂ of the last row, where the next one starts
  Extended last{};    ///< last row
  long lines = 0;     ///< rows used so far
  long left_out = 0;  ///< rows excluded as a whole (also for want of a pose) or by one reading
  Outcome made{};     ///< outcome of the last row

  Knowledge knowledge() const { return {state.count, state.column, state.root, state.sigma}; }
};

/// Runs one cycle: updates ξ̂ and S by one row of readings. `robot` is then at the ξ of
/// linearisation, `pose` x̂ before ξ̂ moved.
/// @return `disagree`: no update, or none by the reading named; `stopped`: no update until `test`
/// is reset, and ξ̂ and S are back at their last good values. Both come with a pose. Without an
/// answer ξ̂ and S are unchanged, unless a row without a pose stops the filter.
Outcome observe(Level level, OnlineCalibrator& calibrator, const Extended& q_e);
}  // namespace truepose
