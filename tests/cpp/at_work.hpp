// Robots at work: setpoints and readings of control cycles, on robots sampled from their
// tolerances.
#pragma once

#include "control/control.hpp"
#include "mechanisms.hpp"

namespace mechanisms {

/// A robot as calibrated, what is known of it, and the true robot.
class AtWork {
 public:
  /// The calibrated robot is off the nominal one by its tolerances, also 0.1° of yaw and tilt.
  /// @param sensors  redundant readings in use, at most 6: the mechanism's own two, then a
  /// telemeter of height and draw-wires
  AtWork(const Mechanism& mechanism, Level level, int sensors, unsigned seed = 1);

  struct Cycle {
    Setpoint setpoint;
    Extended q_e;
  };
  /// Cycles at 1 kHz on a path through the workspace, up to 0.4 m/s, with a tracking error of up to
  /// a millimetre and the encoders' counts: the estimated pose follows x_d.
  std::vector<Cycle> motion(int count);
  /// Cycles that no robot should meet: a cold start far from the setpoint, a reading that jumps,
  /// whole turns, readings of no pose, numbers that are none, setpoints beyond the workspace.
  std::vector<Cycle> trouble(int count);

  Robot robot, truth;
  Prior prior;

 private:
  /// A pose as far out as the chains reach from home in a random direction.
  Coordinates farthest();

  const Mechanism& mechanism_;
  check::Random random_;
};

/// One of each kind whose rods hold the platform by themselves.
std::vector<Mechanism> every_rod();

}  // namespace mechanisms
