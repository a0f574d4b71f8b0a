// Closed-loop simulation: nominal controller, true plant.
#pragma once

#include <functional>

#include "control/command.hpp"
#include "control/guarded_control.hpp"
#include "estimation/online_calibrator.hpp"
#include "simulation/bus.hpp"
#include "simulation/effects.hpp"
#include "simulation/faults.hpp"

namespace truepose {
/// One sample of the log, at the start of a control period.
struct Sample {
  double time;
  Coordinates x_d, x;  ///< desired; true
  Extended q_e;        ///< as read
  Joint error;         ///< ê_q
  Status status;       ///< of the controller; without an answer the last torque is held
  bool gave_up;        ///< the calibrator has stopped; remains true
  std::array<Health, kMaxReadings> health{};    ///< of the readings, by the fault monitor
  std::array<Symptom, kMaxReadings> symptom{};  ///< latest reason why a reading is not valid
  bool stops = false;                           ///< controlled stop on the path
  DisturbanceReport disturbance{};              ///< of the supervisor,
  bool refused = false;                         ///< also: too heavy to be fed forward
  GuardReport machine{};                        ///< torques and brakes, and what stopped it
};

/// A user-defined law: from desired pose and readings to the motor error. It may throw.
using OwnLaw = std::function<Joint(const Coordinates& x_d, const Extended&)>;

/// Optional parts of a loop.
struct Extras {
  Weighing weighing{};                     ///< for the laws `weighted` and `estimated`
  Effects effects{};                       ///< effects that the model omits
  OnlineCalibrator* calibrator = nullptr;  ///< enables online calibration
  FaultyReadings* faults = nullptr;  ///< the loop then goes on without an answer, as machines do
  double began = 0;                  ///< start time of the loop on the faults' clock, s
  const FaultTolerantSettings* fault_settings = nullptr;  ///< enables fault-tolerant control
  Weighing monitor_weighing{};                            ///< weights of the fault monitor
  const MultirateSettings* bus = nullptr;                 ///< multirate sensors of the true robot,
  const MultirateSettings* late = nullptr;                ///< and as the controller models them
  OwnLaw law{};                 ///< replaces the law `joint` of the settings
  std::vector<Event> events{};  ///< disturbances of the true robot
  Guard* guard = nullptr;       ///< a package's, between law and machine
};

/// Setpoints of a path, by period; fractional where it slows down.
using Path = std::function<Setpoint(double period)>;
/// Receives the samples of a run.
using Write = std::function<void(const Sample&)>;

/// A robot and its controller, with the state that persists between moves.
class Loop {
 public:
  /// @param start  true pose of the robot at rest
  Loop(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
       const Coordinates& start, std::uint64_t seed, const Extras& extras = {});

  /// Runs along a path from rest; calls write(sample) once per period, end included. A
  /// fault-tolerant controller that must stop stops on it.
  /// @return ok, or the failure that ended it: the plant's, or, without faults, the controller's
  Outcome follow(int periods, int steps, const Path& path, const Write& write);

  /// One cycle of the controller at another simulator's readings. @param frozen  as for run_cycle()
  /// @return of the controller
  Status step(const Setpoint& setpoint, const Extended& q_e, bool frozen);

  /// Torques, brakes and stop for the machine: the guard's report; without one the controller's
  /// torque and what its fault monitor requests, of state -1.
  GuardReport report() const;

  PathClock clock;  ///< of the path

 private:
  /// Begins and ends disturbances in the period from `time` on.
  void disturb(double time);

  /// Readings and results of one cycle of the controller.
  struct Cycle {
    Extended q_e{};
    Status status{};
    bool gave_up = false;
  };

  /// Reads the sensors of the plant, with faults, and runs the controller.
  /// @return the plant's failure, or, without faults and guard, the controller's
  Outcome run_cycle(Plant& plant, double time, const Setpoint& setpoint, Cycle& cycle);

  /// Runs the controller on readings. @param frozen  the counter of their frame stands still
  Outcome run_controller(double time, const Setpoint& setpoint, Cycle& cycle, bool frozen);

  /// `control` on the error of an own law: the law `joint` on readings that differ by it.
  Outcome control_by_own_law(const Robot& believed, const Setpoint& setpoint, const Extended& q_e);

  /// The law and its guard. An own law is not called before it acts.
  Outcome run_guarded(const Robot& believed, const Setpoint& setpoint, const Extended& q_e,
                      const Weighing& weighing, const Monitored& monitored);

  /// Acknowledges and starts the guard of the robot at rest, until the law acts. The brakes hold
  /// the robot, so the plant's state, that of its noise included, is the same afterwards.
  Outcome switch_on(const Setpoint& setpoint, Cycle& cycle);

  /// The path's clock after a cycle.
  void pace();

  Sample sampled(double time, const Setpoint& setpoint, const Cycle& cycle) const;

  /// Calibrates online while all readings are valid. If one has failed, its latest rows are rolled
  /// back, which changes the calibrated robot.
  bool calibrate_monitored(OnlineCalibrator& calibrator, const Extended& q_e);

  const Robot& nominal_;
  ControlSettings settings_;
  Extras extras_;
  Plant plant_;
  Outcome resting_;
  ControlState control_;
  FaultTolerantState fault_state_;
  Multirate late_;
  Bus bus_;
  Knowledge known_;  ///< with the latency-compensated readings' σ
};
}  // namespace truepose
