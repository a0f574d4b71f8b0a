// Closed-loop simulation: nominal controller, true plant.
#pragma once

#include <functional>

#include "truepose/control/fault_tolerant_control.hpp"
#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/offline/bus.hpp"
#include "truepose/offline/effects.hpp"
#include "truepose/offline/faults.hpp"

namespace truepose {
/// A run: a straight quintic move, then a hold at its end.
struct Run {
  Coordinates from{}, to{};
  double duration = 0.2;   ///< of the move, s
  double hold = 0.2;       ///< after the move, s
  int steps = 2;           ///< integration steps per control period
  std::uint64_t seed = 0;  ///< of the readings' noise
};

/// One sample of the log, at the start of a control period.
struct Sample {
  double time;
  Coordinates x_d, x;  ///< desired; true
  Extended q_e;        ///< as read
  Joint error;         ///< ê_q
  Joint torque;
  Status status;  ///< of the controller; without an answer the last torque is held
  bool gave_up;   ///< the calibrator has stopped; remains true
  std::array<Health, kMaxReadings> health{};    ///< of the readings, by the fault monitor
  std::array<Symptom, kMaxReadings> symptom{};  ///< latest reason why a reading is not valid
  bool stops = false;                           ///< controlled stop on the path
  std::uint32_t brakes = 0;                     ///< motors whose brakes are requested, as bits
  Disturbance disturbance = Disturbance::none;  ///< as the momentum observer names it,
  int disturbed = -1;                           ///< the motor of friction,
  double size = 0;                              ///< mass, friction or force,
  Coordinates force{};                          ///< and the external force
  bool refused = false;                         ///< too heavy to be fed forward
};

/// A user-defined law: from setpoint and readings at a time to the torques. It may throw.
using OwnLaw = std::function<Outcome(double time, const Setpoint&, const Extended&, Joint&)>;

/// Optional parts of a loop.
struct Extras {
  Weighing weighing{};                  ///< for the laws `weighted` and `estimated`
  Effects effects{};                    ///< effects that the model omits
  OnlineCalibrator* learner = nullptr;  ///< enables online calibration
  FaultyReadings* faults = nullptr;     ///< the loop then goes on without an answer, as machines do
  double began = 0;                     ///< start time of the loop on the faults' clock, s
  const FaultTolerantSettings* fault_settings = nullptr;  ///< enables fault-tolerant control
  Weighing monitor_weighing{};                            ///< weights of the fault monitor
  const MultirateSettings* bus = nullptr;                 ///< multirate sensors of the true robot,
  const MultirateSettings* late = nullptr;                ///< and as the controller models them
  OwnLaw law{};                                           ///< replaces `control`
  std::vector<Event> events{};                            ///< disturbances of the true robot
};

/// A robot and its controller, with the state that persists between moves.
template <Mobility K>
class Loop {
 public:
  /// @param start  true pose of the robot at rest
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

  /// Runs one move; calls write(sample) once per period, end included.
  /// @return ok, or the failure that ended it: the plant's, or, without faults, the controller's
  template <class Write>
  Outcome move(const Run& run, Write&& write) {
    const int periods = static_cast<int>(std::lround((run.duration + run.hold) / settings_.period));
    return follow(
        periods, run.steps,
        [&](double k) { return quintic<K>(run.from, run.to, run.duration, k * settings_.period); },
        write);
  }

  /// The same along any path. A fault-tolerant controller that must stop stops on it.
  /// @param path  path(k) -> Setpoint, at the start of period k; fractional k where it slows down
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
      const bool slow = extras_.late;  // readings; torques may be delayed as well
      const bool late = extras_.effects.delayed && control_.started;
      const Joint before = control_.torque;
      OnlineCalibrator* const learner = extras_.learner;
      const bool monitored = extras_.fault_settings && !extras_.law;
      if (extras_.bus) late_.arrived = bus_.deliver(kDof<K>, q_e);
      Extended present = q_e;
      const Weighing weighing =
          slow && !monitored ? compensated<K>(nominal_, extras_.weighing, late_, known_, present)
                             : extras_.weighing;
      bool gave_up =  // a row that fits no pose is skipped
          learner && !monitored && calibrate_online<K>(*learner, present).status == Status::stopped;
      const Robot& believed = learner ? learner->robot : nominal_;
      if (extras_.law)
        outcome = extras_.law(time, setpoint, present, control_.torque);
      else if (extras_.fault_settings)
        outcome = control_fault_tolerant<K>(believed, settings_, *extras_.fault_settings, setpoint,
                                            q_e, control_, extras_.monitor_weighing, fault_state_,
                                            slow ? &late_ : nullptr);
      else
        outcome = control<K>(believed, settings_, setpoint, present, control_, weighing);
      if (learner && monitored) {
        for (int k = 0; k < nominal_.r; ++k)
          if (late_.is(k)) present[kDof<K> + k] = late_.present[k];
        gave_up = learn_monitored(*learner, present);
      }
      control_.started = control_.started || outcome;
      if (!outcome && !extras_.faults) return outcome;
      write(sampled(time, setpoint, q_e, outcome.status, gave_up));
      if (k == periods) break;
      if (clock_.rate == 1 && !fault_state_.stops) clock_.time = k * settings_.period;
      clock_.advance(settings_.period, fault_state_.stop);
      plant_.brake(fault_state_.brakes, settings_.period);
      disturb(extras_.began + time);
      outcome = plant_.advance(late ? before : control_.torque, settings_.period, steps);
      if (!outcome) return outcome;
    }
    extras_.began += periods * settings_.period;
    return {};
  }

 private:
  /// Begins and ends disturbances in the period from `time` on.
  void disturb(double time) {
    const double from = time - settings_.period / 2, to = time + settings_.period / 2;
    for (const Event& event : extras_.events) {
      if (event.begin >= from && event.begin < to) plant_.disturb(event);
      if (event.kind == Disturbance::contact && event.end >= from && event.end < to)
        plant_.disturb(event, -1);
    }
  }

  Sample sampled(double time, const Setpoint& setpoint, const Extended& q_e, Status status,
                 bool gave_up) const {
    Sample sample{time,   setpoint.x,     to_coordinates<K>(plant_.pose()),
                  q_e,    control_.error, control_.torque,
                  status, gave_up};
    sample.stops = fault_state_.stops;
    sample.brakes = fault_state_.brakes;
    const MomentumObserver& observer = fault_state_.observer;
    sample.disturbance = observer.disturbance;
    sample.disturbed = observer.motor;
    sample.size = observer.size;
    sample.force = observer.force;
    sample.refused = observer.refused;
    for (int c = 0; c < kDof<K> + nominal_.r; ++c) {
      sample.health[c] = fault_state_.monitor.reading[c].health;
      sample.symptom[c] = fault_state_.monitor.reading[c].symptom;
    }
    return sample;
  }

  /// Calibrates online while all readings are valid. If one has failed, its latest rows are rolled
  /// back, which changes the calibrated robot.
  bool learn_monitored(OnlineCalibrator& learner, const Extended& q_e) {
    const FaultMonitor& monitor = fault_state_.monitor;
    const bool valid = std::all_of(
        monitor.reading.begin(), monitor.reading.end(),
        [](const MonitoredReading& reading) { return reading.health == Health::valid; });
    if (valid) return calibrate_online<K>(learner, q_e).status == Status::stopped;
    if (monitor.changed) control_.switched = bool(roll_back(learner)) || control_.switched;
    return learner.state.doubt.stopped;
  }

  const Robot& nominal_;
  ControlSettings settings_;
  Extras extras_;
  Plant<K> plant_;
  Outcome resting_;
  ControlState control_;
  FaultTolerantState fault_state_;
  PathClock clock_;
  Multirate late_;
  Bus bus_;
  Knowledge known_;  ///< with the latency-compensated readings' σ
};
}  // namespace truepose
