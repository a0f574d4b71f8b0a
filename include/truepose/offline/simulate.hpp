// What happens when a controller drives a robot? The closed loop: nominal controller, true plant.
#pragma once

#include <functional>

#include "truepose/control/control.hpp"
#include "truepose/estimation/learning.hpp"
#include "truepose/offline/effects.hpp"

namespace truepose {

/// A run: a straight quintic move, then holding its end.
struct Run {
  Joint from{}, to{};
  double duration = 0.2;   ///< of the move, s
  double hold = 0.2;       ///< afterwards, s
  int steps = 2;           ///< integration steps in one control period
  std::uint64_t seed = 0;  ///< of the readings' noise
};

/// One line of the log, at the start of a control period.
struct Sample {
  double time;
  Joint x_d, x;  ///< desired; true
  Extended q_e;  ///< as read
  Joint error;   ///< ê_q
  Joint torque;
  Status status;  ///< of the controller: ok or near_singular
  bool gave_up;   ///< the learner: it has stopped learning, and says so from then on
};

/// A law of one's own: from what is asked and read at a time to the torques. It may throw.
using OwnLaw = std::function<Outcome(double time, const Setpoint&, const Extended&, Joint&)>;

/// What a loop may have beside a robot and its controller.
struct Extras {
  Weighing weighing{};         ///< for the laws `weighted` and `estimated`
  Effects effects{};           ///< what the model forgets
  Learner* learner = nullptr;  ///< switches online self-calibration on
  OwnLaw law{};                ///< commands instead of `control`
};

/// A robot, its controller, and what both remember from one move to the next.
template <Mobility K>
class Loop {
 public:
  /// @param start  true pose at which the robot stands
  Loop(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
       const Joint& start, std::uint64_t seed, const Extras& extras = {})
      : nominal_(nominal),
        settings_(settings),
        extras_(extras),
        plant_(truth, extras.effects, to_pose<K>(start), seed),
        resting_(plant_.rest()) {}

  /// Runs one move; `write(sample)` is called once per period, end included.
  /// @return the first failure and what the log holds up to it, or ok
  template <class Write>
  Outcome move(const Run& run, Write&& write) {
    const int periods = static_cast<int>(std::lround((run.duration + run.hold) / settings_.period));
    return follow(
        periods, run.steps,
        [&](int k) { return quintic<K>(run.from, run.to, run.duration, k * settings_.period); },
        write);
  }

  /// The same along any path.
  /// @param path  path(k) -> Setpoint, at the start of period k
  template <class Path, class Write>
  Outcome follow(int periods, int steps, Path&& path, Write&& write) {
    if (!resting_) return resting_;
    for (int k = 0; k <= periods; ++k) {
      const double time = k * settings_.period;
      const Setpoint setpoint = path(k);
      Extended q_e{};
      Outcome outcome = plant_.measure(q_e);
      if (!outcome) return outcome;
      const bool late = extras_.effects.delayed && control_.started;
      const Joint before = control_.torque;
      const bool gave_up =  // a line that fits no pose: next time
          extras_.learner && learn<K>(*extras_.learner, q_e).status == Status::stopped;
      const Robot& believed = extras_.learner ? extras_.learner->robot : nominal_;
      outcome = extras_.law
                    ? extras_.law(time, setpoint, q_e, control_.torque)
                    : control<K>(believed, settings_, setpoint, q_e, control_, extras_.weighing);
      control_.started = control_.started || outcome;
      if (!outcome) return outcome;
      write(Sample{time, setpoint.x, to_coordinates<K>(plant_.pose()), q_e, control_.error,
                   control_.torque, outcome.status, gave_up});
      if (k == periods) break;
      outcome = plant_.advance(late ? before : control_.torque, settings_.period, steps);
      if (!outcome) return outcome;
    }
    return {};
  }

 private:
  const Robot& nominal_;
  ControlSettings settings_;
  Extras extras_;
  Plant<K> plant_;
  Outcome resting_;
  ControlState control_;
};

/// One move of a robot that starts at rest where `start` says (its true pose).
template <Mobility K, class Write>
inline Outcome simulate(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
                        const Run& run, const Joint& start, Write&& write,
                        const Extras& extras = {}) {
  return Loop<K>(nominal, truth, settings, start, run.seed, extras).move(run, write);
}

}  // namespace truepose
