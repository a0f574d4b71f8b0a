// A simulated robot in its start-up test, with brakes that open, and wires that are exchanged.
#pragma once

#include "safety/start_test.hpp"
#include "safety_bench.hpp"

namespace mechanisms {

/// A wrong wire: a reading (or the torque of a motor) reversed or frozen, or two exchanged.
struct Miswiring {
  StartFinding kind = StartFinding::none;
  int a = -1, b = -1;
  double gain = 1;           ///< of StartFinding::scale
  bool incremental = false;  ///< readings are right at the start
};

/// What the true robot has beyond the model.
struct Truth {
  double mass = 1, friction = 1;  ///< factors
  double opens = kBrakeCloses, closes = kBrakeCloses;
};

/// A robot with coulomb friction of 0.5 % of its motors' torque limits.
Robot rubbing(Robot robot, const Truth& truth);

struct StartBench {
  explicit StartBench(const Robot& nominal, const Truth& is = {}, const Coordinates* from = nullptr,
                      double period = 1e-3);

  Extended read(const Miswiring& wrong);

  /// Runs the test to its end; checks what must hold in every cycle.
  void run(const Miswiring& wrong = {}, bool known = true);
  bool passed() const { return test.state == StartState::passed; }
  bool found(StartFinding finding, int part) const;
  /// Whether the test has named a miswiring.
  bool named(const Miswiring& wrong) const;
  /// Whether it lists it among others.
  bool listed(const Miswiring& wrong) const;

  Mobility K;
  int n;
  Robot robot, truth;
  Prior prior;
  Pose started;
  Plant plant;
  Truth real;
  SafetyLimits limits;
  StartSettings settings;
  StartTest test;
  Extended first{};
  std::function<void(int cycle, Extended& q_e)> spoil;
  double moved = 0, largest = 0, seconds = 0;
};

/// An H4 with θ, and with an elbow encoder as well.
Robot h4_with(int sensors);
}  // namespace mechanisms
