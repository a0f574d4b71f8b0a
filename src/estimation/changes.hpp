// Changes of a robot in its life: which of them the rows of a window show.
//
// A change is a step a·d of the geometry from the window's first row on, a ~ N(0, 1), or an error
// of one reading. A filter that knows of none runs over the rows; a step shifts its innovations ν
// by a·w, w the filter's response to d (Willsky and Jones, A generalized likelihood ratio approach,
// 1976). With z = Σ w ν / σ_ν² and S = Σ w wᵀ / σ_ν² of the steps that happen together, the log
// odds over no change are their evidence (evidence.hpp) + log rate. Bounded work a row, no
// allocation, no exception.
#pragma once

#include "estimation/root_filter.hpp"

namespace truepose {
/// Changes to expect: truepose_changes. Constant during a run.
struct ChangeSettings {
  int steps = 0;   ///< number of steps
  int count = 0;   ///< number of changes: the steps that happen together
  int drifts = 0;  ///< independent random walks, each of one or several parameters together
  /// A step that is a payload: its force F turns or shifts each motor by its compliance · Jᵀ F.
  /// `step` has the nearest constant one, by which the geometry follows. -1: none
  int load = -1;
  const Real* step = nullptr;         ///< steps × p: d of each, 1 σ
  const std::int32_t* end = nullptr;  ///< index after the last step of each change, increasing
  const Real* log_odds = nullptr;     ///< of each change in a window
  const Real* drift = nullptr;  ///< drifts × p: change of every parameter by one σ in one cycle
  Coordinates force{};
  Joint compliance{};
};

enum class ChangeKind : std::int32_t { part, fault, noise, unexplained };

/// A change that was recognised.
struct Recognised {
  long row = 0;  ///< rows observed until then
  ChangeKind kind{};
  int which = -1;     ///< change or reading; -1: none alone
  Real log_odds = 0;  ///< over no change
};

inline constexpr int kWindow = 100;  ///< rows explained together
inline constexpr int kDecide = 50;   ///< rows between decisions
inline constexpr int kStored = kWindow + kWindow / 2;
inline constexpr int kNews = 8;           ///< recognised changes that are kept
inline constexpr int kOpenings = 8;       ///< changes of one window, one after another
inline constexpr Real kDecisive = 0.9;    ///< probability of a change
inline constexpr Real kFault = 0.02;      ///< σ of a faulty reading's bias and drift, rad or m
inline constexpr Real kLogFault = -11;    ///< log odds of a reading's fault in a window
inline constexpr Real kLogNoise = -6;     ///< the same of more noise
inline constexpr Real kNeglected = 0.03;  ///< probability of a change, given that there is one
inline constexpr Real kUsed = 0.9;        ///< share of rows that must have a pose and not be gross
inline constexpr Real kFit = 5;           ///< σ beyond which rows are not explained
/// Factors of a reading's σ that are tried; the first where it is larger than at first.
inline constexpr std::array<Real, 3> kFactor{0.5, 2, 5};

inline constexpr Real kNoisiest = 17;  ///< largest factor of all

/// Filter without a change, and the responses. Arrays are the caller's.
struct Window {
  RootFilter base, filter;   ///< at its start; the same after its rows
  Real* response = nullptr;  ///< by step, then bias and drift of each reading; also these:
  Real *z = nullptr, *product = nullptr;  ///< z, and the row of S that belongs to its change
  Real* share = nullptr;                  ///< of each step's variance that was added at the start
  Real* scratch = nullptr;                ///< of a decision, and w of a row
  int widest = 0;                         ///< steps of one change at most
  Real* stored = nullptr;                 ///< kStored × readings
  Real* about = nullptr;                  ///< ξ of linearisation of a replay
  std::array<Extended, kFactor.size()> noisy{};  ///< log odds
  Extended sigma{}, before{};                    ///< of new readings; at the window's start
  int rows = 0, used = 0;                        ///< with a pose; in the filter
  int last = 0, next = 0;                        ///< rows stored, and the next one to process
  int goal = 0, passes = 0;                      ///< end of a replay, and passes left
  int openings = 0, freedom = 0;
  Real chi2 = 0;
  Real moved = 0;      ///< amount of the payload by which the start was moved
  bool gross = false;  ///< the last row was far off
  int suspect = -1;    ///< reading that alone explains why the filter stopped
  bool fault = false;  ///< a fault was reported, and no window without one has followed
  std::array<Recognised, kOpenings> opened{};  ///< changes of this window, reported at its end
  std::array<Recognised, kNews> news{};
  long recognised = 0;  ///< number of changes so far; the last kNews in turn in `news`
};

/// Lays out a window's arrays. @param filter  the calibration's @param memory  nullptr: no array
/// @return numbers of memory
int lay_out(const Robot& robot, const RootFilter& filter, const ChangeSettings& changes,
            Real* memory, Window& window);

/// Adds a row to a window's evidence. @param sigma  of the readings @param work  2 r p numbers
void add_row(const ChangeSettings& changes, const Extended& sigma, const Equations& row,
             Window& window, Real* work);

/// Decision over a window's rows.
struct Finding {
  bool decisive = false;  ///< a change happened
  bool fits = true;       ///< the likeliest explanation explains the rows
  bool unchanged = true;  ///< no change is likelier than any
  Recognised likeliest{};
};
/// Weighs the changes. If parts are decisive, adds their shares to `window.share`; if noise, scales
/// `sigma`.
Finding decide(const ChangeSettings& changes, int readings, Window& window, Extended& sigma);

/// Restarts the window's filter from its base with the changes added so far.
void restart(const ChangeSettings& changes, int readings, Window& window, Real* work);
}  // namespace truepose
