// Online calibration beside the control cycle.
//
// Between readings and torque, the online filter (online_calibration.hpp) updates ξ by this row of
// readings. From then on the controller uses the robot at ξ̂; with a window of changes, one that
// approaches ξ̂.
#pragma once

#include "estimation/online_calibration.hpp"

namespace truepose {
/// Numbers of memory to start: ξ̂ and S, the same to roll back to, work space.
inline int online_memory(const Robot& drawn, int count) {
  return 2 * (parameter_count(drawn) + count * count) + online_work(drawn, count);
}
/// Starts at the nominal geometry. @param prior  its root is copied
Outcome start(const Robot& drawn, const Knowledge& prior, Real* memory,
              OnlineCalibrator& calibrator);

/// Numbers of memory to follow changes.
inline int follow_memory(const OnlineCalibrator& of, const ChangeSettings& changes) {
  Window window;
  return lay_out(*of.drawn, of.state, changes, nullptr, window) + parameter_count(*of.drawn);
}
/// Recognises changes from now on, and follows them. All arguments must stay in place.
void follow(const ChangeSettings& changes, Real* memory, Window& window,
            OnlineCalibrator& calibrator);

inline constexpr Real kJump = 0.3;   ///< a tenth of a count, whose σ is its width over √12
inline constexpr int kReplayed = 3;  ///< rows of a cycle at most, when a change was recognised

/// Whether rows wait to be processed: the robot is the one before.
inline bool replaying(const OnlineCalibrator& of) {
  return of.state.window && of.state.window->next < of.state.window->last;
}

/// Runs one cycle. Bounded work, no allocation, no exception.
/// @return outcome of this row or, if it is no information, of the last one: only `ok` means that
/// all of it was used. `stopped` from the cycle in which the filter stops, with the last good
/// robot; with a window, until the rows agree again or a change explains them
Outcome calibrate_online(Level level, OnlineCalibrator& calibrator, const Extended& q_e);

/// The same at the robot's own level.
inline Outcome calibrate_online(OnlineCalibrator& calibrator, const Extended& q_e) {
  return calibrate_online(level_of(*calibrator.drawn), calibrator, q_e);
}

/// Rolls back to before the latest rows (online_calibration.hpp saves that state, with a gate), for
/// a reading found faulty only after its fault began.
Outcome roll_back(OnlineCalibrator& calibrator);
}  // namespace truepose
