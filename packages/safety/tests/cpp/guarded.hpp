// A robot inside the safety shell that follows its path exactly, and what holds in every cycle.
#pragma once

#include "control/limit_defaults.hpp"
#include "control/trajectory.hpp"
#include "controllers.hpp"
#include "rotational.hpp"
#include "safety/safety_shell.hpp"

namespace pivots_tested {

/// Limits, a shell, and a robot that follows its path exactly, but for counts.
struct Guarded {
  explicit Guarded(const Mechanism& mechanism);

  /// The next healthy cycle: the path goes on while the law acts.
  SafetyCycle healthy();

  /// One cycle, and what holds in every one.
  void step(const SafetyCycle& cycle);
  void run_for(int count);
  /// By buttons that are let go.
  void press(bool SafetyRequests::* button);
  void to_ready();
  void to_running();
  /// Cycles that any stop takes.
  int rest() const;
  /// Cycles from now on until it stops. @param change  change(cycle, number of the cycle)
  int until_stop(int most, const std::function<void(SafetyCycle&, int)>& change);

  Mobility K;
  int n;
  Robot robot;
  SafetyLimits limits;
  SafetyShell shell;
  SafetyRequests request;
  Joint weight{};
  double time = 0;
  std::uint64_t frame = 0;
};

/// Robots of one to six motors.
void for_some_guarded(const std::function<void(const Mechanism&)>& f);

}  // namespace pivots_tested
