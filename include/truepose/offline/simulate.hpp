// The closed loop: nominal controller, true plant.
#pragma once

#include <functional>

#include "truepose/control/fault_tolerant_control.hpp"
#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/offline/bus.hpp"
#include "truepose/offline/effects.hpp"
#include "truepose/offline/faults.hpp"

namespace truepose {

/// A run: a straight quintic move, then holding its end.
struct Run {
  Coordinates from{}, to{};
  double duration = 0.2;   ///< of the move, s
  double hold = 0.2;       ///< afterwards, s
  int steps = 2;           ///< integration steps in one control period
  std::uint64_t seed = 0;  ///< of the readings' noise
};

/// One line of the log, at the start of a control period.
struct Sample {
  double time;
  Coordinates x_d, x;  ///< desired; true
  Extended q_e;        ///< as read
  Joint error;         ///< ê_q
  Joint torque;
  Status status;  ///< of the controller; where there is no answer, the torque held is the last one
  bool gave_up;   ///< the learner: it has stopped learning, and says so from then on
  std::array<Health, kMaxReadings> health{};  ///< of the readings, as a guarded controller has them
  std::array<Symptom, kMaxReadings> symptom{};  ///< why not, the latest
  bool stops = false;                           ///< it leaves its path at rest
  std::uint32_t brakes = 0;                     ///< motors whose brakes it asks for, as bits
};

/// A law of one's own: from what is asked and read at a time to the torques. It may throw.
using OwnLaw = std::function<Outcome(double time, const Setpoint&, const Extended&, Joint&)>;

/// What a loop may have beside a robot and its controller.
struct Extras {
  Weighing weighing{};                  ///< for the laws `weighted` and `estimated`
  Effects effects{};                    ///< effects that the model omits
  OnlineCalibrator* learner = nullptr;  ///< switches online self-calibration on
  FaultyReadings* faults = nullptr;  ///< as a machine does, the loop then goes on without an answer
  double began = 0;                  ///< when the loop is made, by the faults' clock, s
  const FaultTolerantSettings* guarding = nullptr;  ///< its readings are watched
  Weighing watching{};                              ///< what the watch weighs them by
  const MultirateSettings* bus = nullptr;           ///< slow and late sensors of the true robot,
  const MultirateSettings* late = nullptr;          ///< and as the controller knows them
  OwnLaw law{};                                     ///< commands instead of `control`
};

/// A robot, its controller, and what both remember from one move to the next.
template <Mobility K>
class Loop {
 public:
  /// @param start  true pose at which the robot stands
  Loop(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
       const Coordinates& start, std::uint64_t seed, const Extras& extras = {})
      : nominal_(nominal),
        settings_(settings),
        extras_(extras),
        plant_(truth, extras.effects, to_pose<K>(start), seed),
        resting_(plant_.rest()),
        bus_(extras.bus ? *extras.bus : MultirateSettings{}) {
    if (extras.late && resting_) resting_ = truepose::start(*extras.late, late_);
  }

  /// Runs one move; `write(sample)` is called once per period, end included.
  /// @return ok, or the failure that ended it: the plant's, or, without faults, the controller's
  template <class Write>
  Outcome move(const Run& run, Write&& write) {
    const int periods = static_cast<int>(std::lround((run.duration + run.hold) / settings_.period));
    return follow(
        periods, run.steps,
        [&](double k) { return quintic<K>(run.from, run.to, run.duration, k * settings_.period); },
        write);
  }

  /// The same along any path. A guarded robot that must stop comes to rest on it.
  /// @param path  path(k) -> Setpoint, at the start of period k; between two where it slows down
  template <class Path, class Write>
  Outcome follow(int periods, int steps, Path&& path, Write&& write) {
    if (!resting_) return resting_;
    for (int k = 0; k <= periods; ++k) {
      const double time = k * settings_.period;
      const Setpoint setpoint = clock_.rate < 1 ? clock_.paced(path(clock_.time / settings_.period))
                                                : path(static_cast<double>(k));
      Extended q_e{};
      Outcome outcome = plant_.measure(q_e);
      if (!outcome) return outcome;
      if (extras_.faults) extras_.faults->read(extras_.began + time, q_e);
      const bool slow = extras_.late;  // readings; a torque may be late as well
      const bool late = extras_.effects.delayed && control_.started;
      const Joint before = control_.torque;
      OnlineCalibrator* const learner = extras_.learner;
      const bool watched = extras_.guarding && !extras_.law;
      if (extras_.bus) late_.arrived = bus_.deliver(kDof<K>, q_e);
      Extended present = q_e;
      const Weighing weighing = slow && !watched ? brought_up(present) : extras_.weighing;
      bool gave_up =  // a line that fits no pose: next time
          learner && !watched && calibrate_online<K>(*learner, present).status == Status::stopped;
      const Robot& believed = learner ? learner->robot : nominal_;
      if (extras_.law)
        outcome = extras_.law(time, setpoint, present, control_.torque);
      else if (extras_.guarding)
        outcome =
            control_fault_tolerant<K>(believed, settings_, *extras_.guarding, setpoint, q_e,
                                      control_, extras_.watching, guard_, slow ? &late_ : nullptr);
      else
        outcome = control<K>(believed, settings_, setpoint, present, control_, weighing);
      if (learner && watched) {
        for (int k = 0; k < nominal_.r; ++k)
          if (late_.is(k)) present[kDof<K> + k] = late_.present[k];
        gave_up = learn_watched(*learner, present);
      }
      control_.started = control_.started || outcome;
      if (!outcome && !extras_.faults) return outcome;
      Sample sample{time,
                    setpoint.x,
                    to_coordinates<K>(plant_.pose()),
                    q_e,
                    control_.error,
                    control_.torque,
                    outcome.status,
                    gave_up};
      for (int c = 0; c < kDof<K> + nominal_.r; ++c) {
        sample.health[c] = guard_.watch.reading[c].health;
        sample.symptom[c] = guard_.watch.reading[c].symptom;
      }
      sample.stops = guard_.stops;
      sample.brakes = guard_.brakes;
      write(sample);
      if (k == periods) break;
      if (clock_.rate == 1 && !guard_.stops) clock_.time = k * settings_.period;
      clock_.advance(settings_.period, guard_.stop);
      plant_.brake(guard_.brakes, settings_.period);
      outcome = plant_.advance(late ? before : control_.torque, settings_.period, steps);
      if (!outcome) return outcome;
    }
    extras_.began += periods * settings_.period;
    return {};
  }

 private:
  /// Slow and late readings as of now, where nobody watches them. @return what is known of them
  Weighing brought_up(Extended& present) {
    const Weighing& weighing = extras_.weighing;
    if (!compensate_latency<K>(nominal_, late_, present)) return weighing;
    low_pass(nominal_, late_, present);
    if (!weighing) return weighing;
    known_ = *weighing.known;
    weigh(nominal_, late_, known_);
    return {&known_, weighing.work, weighing.kept};
  }

  /// What the watch has seen is learnt where all of it is valid. Of a reading that has failed by
  /// now the latest lines are forgotten; the robot that is believed changes with that.
  bool learn_watched(OnlineCalibrator& learner, const Extended& q_e) {
    const FaultMonitor& watch = guard_.watch;
    const bool valid = std::all_of(
        watch.reading.begin(), watch.reading.end(),
        [](const MonitoredReading& reading) { return reading.health == Health::valid; });
    if (valid) return calibrate_online<K>(learner, q_e).status == Status::stopped;
    if (watch.changed) control_.switched = bool(roll_back(learner)) || control_.switched;
    return learner.state.doubt.stopped;
  }

  const Robot& nominal_;
  ControlSettings settings_;
  Extras extras_;
  Plant<K> plant_;
  Outcome resting_;
  ControlState control_;
  FaultTolerantState guard_;
  PathClock clock_;
  Multirate late_;
  Bus bus_;
  Knowledge known_;  ///< of readings of which some are late
};

/// One move of a robot that starts at rest where `start` says (its true pose).
template <Mobility K, class Write>
inline Outcome simulate(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
                        const Run& run, const Coordinates& start, Write&& write,
                        const Extras& extras = {}) {
  return Loop<K>(nominal, truth, settings, start, run.seed, extras).move(run, write);
}

}  // namespace truepose
