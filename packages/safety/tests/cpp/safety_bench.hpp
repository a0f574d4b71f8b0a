// A simulated robot under a law inside the safety shell, with brakes and faults of its frames.
#pragma once

#include <functional>

#include "control/limit_defaults.hpp"
#include "controllers.hpp"
#include "safety/safety_guard.hpp"
#include "simulation/effects.hpp"

namespace mechanisms {

/// The robot with counts on its encoders and torque limits of several times its weight.
Robot limited_robot(const Mechanism& mechanism);

/// What the true robot has beyond the nominal one; by default nothing.
struct Reality {
  double length = 0;    ///< error of rods, m
  double friction = 0;  ///< of motors, over their torque limit; the model has none
  double ripple = 0;    ///< of their torque
};

Robot true_robot(Robot robot, const Reality& reality);

Effects effects_of(const Robot& robot, const Reality& reality);

/// One robot, its controller and shell.
struct Bench {
  using Spoil = std::function<void(Extended& q_e, SafetyCycle& cycle, Setpoint& setpoint)>;

  explicit Bench(const Mechanism& mechanism, Law law = Law::joint, FeedForward forward = {},
                 const Reality& reality = {});
  Bench(const Bench&) = delete;

  /// One cycle; checks what must hold in every one.
  void cycle(const Spoil& spoil = {});
  /// Cycles until a condition holds. @return their number; -1: more than `most`
  int cycles(int most, const std::function<bool()>& until, const Spoil& spoil = {});
  void run_for(int count, const Spoil& spoil = {});

  /// From switching on to the law in action.
  void begin();
  /// A move of the whole robot, whose clock begins now.
  void move(const Coordinates& target, double time);
  double travelled(const Pose& since) const;
  /// Nothing has stopped it.
  bool healthy() const { return shell.machine.state == SafetyState::running && shell.causes == 0; }

  Mobility K;
  int n;
  Robot robot, truth;
  Prior prior;
  ControlSettings settings;
  SafetyGuard guard;
  SafetyLimits& limits = guard.limits;
  SafetyShell& shell = guard.shell;
  ControlState state;
  Plant plant;
  PathClock clock;
  Coordinates from, to;
  double duration = 1;
  SafetyRequests request;
  Monitored monitored;
  std::uint64_t frame = 0;
  bool ran = false;
};

}  // namespace mechanisms
