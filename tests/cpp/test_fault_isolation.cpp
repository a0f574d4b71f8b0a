// Isolation of the faulty reading.
#include "control/fault_tolerant_control.hpp"
#include "mechanisms.hpp"
#include "moves.hpp"

using namespace mechanisms;

namespace {

constexpr Mobility K = Mobility::schoenflies;
constexpr int kTheta = dof(K);

/// An H4 whose motors have 14400 counts a turn, fault-tolerant, with one faulty reading.
struct Faulty {
  explicit Faulty(Law law) : mechanism(h4()), prior((count(), mechanism.robot)) {
    settings.law = law;
    settings.gains = Gains::inertia;
    CHECK(place_poles(mechanism.robot, mechanism.robot.home, 150, 1, settings));
    FaultMonitorSettings& monitor = fault_settings.monitor;
    monitor.fastest.fill(3000);
    monitor.moved.fill(10 * kCount);
    monitor.rests.fill(4 * kCount);
    monitor.kp = settings.kp;
    monitor.kd = settings.kd;
    prepare(monitor);
  }
  void count() {
    for (int i = 0; i < dof(K); ++i) {
      mechanism.robot.chain[i].encoder_step = kCount;
      mechanism.robot.chain[i].torque_limit = 30;
    }
    mechanism.robot.sensor[0].step = 1e-4;
  }

  /// Readings that have failed by the end of a move of 0.3 s, as bits.
  std::uint32_t failed(const Fault& fault, check::Random& random) {
    const Robot& robot = mechanism.robot;
    FaultyReadings faults({fault}, settings.period);
    Extras extras{prior.weighing()};
    extras.monitor_weighing = extras.weighing;
    extras.fault_settings = &fault_settings;
    extras.faults = &faults;
    const Coordinates from = random_pose(mechanism, random), to = random_pose(mechanism, random);
    std::uint32_t bits = 0;
    const auto write = [&](const Sample& sample) {
      for (int c = 0; c <= kTheta; ++c)
        if (sample.health[c] == Health::failed) bits |= bit(c);
    };
    static_cast<void>(
        run_move(Loop(robot, robot, settings, from, 0, extras), K, from, to, 0.3, 0.2, write));
    return bits;
  }

  static constexpr double kCount = 2 * std::numbers::pi / 14400;
  Mechanism mechanism;
  Prior prior;
  ControlSettings settings;
  FaultTolerantSettings fault_settings;
};

}  // namespace

TEST("where a late sensor makes the loop swing no motor is called stuck that turns") {
  int wrong = 0;
  for (const Law law : {Law::tej, Law::cartesian, Law::estimated}) {
    check::Random random(74);
    Faulty scene(law);
    for (int move = 0; move < 30; ++move) {
      const Fault late{FaultKind::delay, kTheta, 0, 0.005, 0.05 + 0.005 * move};
      wrong += (scene.failed(late, random) & (bit(kTheta) - 1)) != 0;
    }
  }
  // One that was still when the first push of the late sensor held it: nothing had swung before.
  CHECK(wrong <= 1);
}

TEST("a motor whose encoder freezes in motion is named under every law") {
  for (const Law law : {Law::joint, Law::tej, Law::cartesian, Law::estimated}) {
    check::Random random(75);
    Faulty scene(law);
    for (int motor = 0; motor < kTheta; ++motor) {
      const Fault stuck{FaultKind::stuck, motor, 0, 0, 0.12};
      CHECK(scene.failed(stuck, random) == bit(motor));
    }
  }
}
