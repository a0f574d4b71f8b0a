// A control path without blocking calls. clang's RealtimeSanitizer watches it run,
// and -Wfunction-effects, here an error, proves the same when compiling (preset `realtime`).
//
// clang infers the effects of inline functions it can see, so the headers need no annotation: the
// attribute on these loops covers all that they call.
#include <cstdlib>

#include "mechanisms.hpp"
#include "truepose/control/command.hpp"
#include "truepose/control/safe_control.hpp"
#include "truepose/full/linearise.hpp"
#include "truepose/offline/safety_defaults.hpp"

using namespace mechanisms;

namespace {

struct Cycle {
  Setpoint setpoint;
  Extended q_e;
};

long run_control(const Robot& robot, const ControlSettings& settings,
                 const std::vector<Cycle>& cycles, ControlState& state,
                 const Weighing& weighing) noexcept [[clang::nonblocking]] {
  long failures = 0;
  const Cycle* cycle = cycles.data();
  for (std::size_t k = 0; k < cycles.size(); ++k)
    if (!control(robot, settings, cycle[k].setpoint, cycle[k].q_e, state, weighing)) ++failures;
  return failures;
}

/// Every eighth cycle a reading is faulty, another each time; those that fail of it are restored.
template <Mobility K>
long run_fault_tolerant(const Robot& robot, const ControlSettings& settings,
                        const FaultTolerantSettings& fault_settings,
                        const std::vector<Cycle>& cycles, ControlState& state,
                        const Weighing& weighing, FaultTolerantState& fault_state,
                        Multirate& late) noexcept [[clang::nonblocking]] {
  long faults = 0;
  PathClock clock;
  const Cycle* cycle = cycles.data();
  for (std::size_t k = 0; k < 4 * cycles.size(); ++k) {
    const std::size_t at = k % cycles.size();
    const int c = static_cast<int>(k / 8) % (kDof<K> + robot.r);
    Extended q_e = cycle[at].q_e;
    if (k % 8 == 7) q_e[c] = k % 16 == 7 ? NAN : q_e[c] + 1;
    clock.advance(settings.period, fault_state.stop);
    late.arrived = arrivals(late.settings, late.cycle);
    const Outcome outcome =
        control_fault_tolerant<K>(robot, settings, fault_settings, clock.paced(cycle[at].setpoint),
                                  q_e, state, weighing, fault_state, &late);
    if (outcome.status == Status::disagree) ++faults;
    if (k % 128 == 127) acknowledge(fault_state.monitor, c);
  }
  return faults;
}

/// The same inside the safety shell, which is started again and again.
template <Mobility K>
long run_safely(const Robot& robot, const ControlSettings& settings, const SafetyLimits& limits,
                const std::vector<Cycle>& cycles, ControlState& state, const Weighing& weighing,
                const Monitored& monitored) noexcept [[clang::nonblocking]] {
  long follows = 0;
  SafetyShell shell;
  const Cycle* cycle = cycles.data();
  for (std::size_t k = 0; k < cycles.size(); ++k) {
    SafetyCycle marks;
    marks.request.acknowledge = k % 100 == 30;
    marks.request.start = k % 100 == 31;
    static_cast<void>(control_safely<K>(robot, settings, limits, cycle[k / 500].setpoint,
                                        cycle[k / 500].q_e, state, shell, marks, weighing,
                                        monitored));
    follows += shell.follows;
    if (k % 100 == 90) shell = {};
  }
  return follows;
}

template <Mobility K>
long run_learner(OnlineCalibrator& learner, const std::vector<Cycle>& cycles) noexcept
    [[clang::nonblocking]] {
  long failures = 0;
  const Cycle* cycle = cycles.data();
  for (std::size_t k = 0; k < cycles.size(); ++k)
    if (!calibrate_online<K>(learner, cycle[k].q_e)) ++failures;
  return failures;
}

long run_models(const Robot& robot, const std::vector<Cycle>& cycles) noexcept
    [[clang::nonblocking]] {
  long failures = 0;
  const Cycle* cycle = cycles.data();
  for (std::size_t k = 0; k < cycles.size(); ++k) {
    Joint q{}, x = cycle[k].setpoint.x;
    Reading r{};
    ExtendedColumns M;
    ExtendedRows M_plus;
    if (!ikm(robot, x, q) || !rkm(robot, x, r) || !tej(robot, x, M, M_plus)) ++failures;
    if (!command(robot, x, q)) ++failures;
    x = robot.home;
    if (!fkm(robot, q, x)) ++failures;
    q[0] += 1;  // mostly out of reach: the failing ways count as well
    static_cast<void>(fkm(robot, q, x));
    JointMatrix J;
    x = cycle[k].setpoint.x;
    if (robot.full.kind != FullKind::overconstrained &&
        (!ikm_full(robot, x, q) || !rkm_full(robot, x, r) || !jacobian_full(robot, x, J) ||
         !fkm_full(robot, q, x)))
      ++failures;
    q[0] += 1;
    static_cast<void>(fkm_full(robot, q, x));
  }
  return failures;
}

#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wfunction-effects"
/// What the sanitizer must stop: shows that it watches at all.
void* allocate_in_real_time(std::size_t size) noexcept [[clang::nonblocking]] {
  return std::malloc(size);
}
#pragma clang diagnostic pop

}  // namespace

TEST("no law and no model blocks, on any mechanism") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 2;
    Prior prior(robot);
    check::Random random(81);
    std::vector<Cycle> cycles(2000);
    for (Cycle& cycle : cycles) {
      cycle.setpoint.x = random_pose(mechanism, random);
      cycle.setpoint.rate = random_joint(random, 0.5);
      cycle.setpoint.acceleration = random_joint(random, 5);
      const Pose pose = nearby<K>(to_pose<K>(cycle.setpoint.x), random, 1e-3);
      CHECK(extended<K>(robot, pose, cycle.q_e));
    }
    for (const Law law : kLaws) {
      ControlSettings settings;
      settings.law = law;
      CHECK(place_poles(robot, robot.home, 100, 1, settings));
      ControlState state;
      CHECK(run_control(robot, settings, cycles, state, prior.weighing()) == 0);
    }
    for (const Law law : {Law::joint, Law::tej, Law::estimated}) {
      ControlSettings settings;
      settings.law = law;
      CHECK(place_poles(robot, robot.home, 100, 1, settings));
      FaultTolerantSettings fault_settings;
      fault_settings.monitor.fastest.fill(500);
      fault_settings.monitor.moved.fill(2e-3);
      prepare(fault_settings.monitor);
      ControlState state;
      FaultTolerantState fault_state;
      Multirate late;
      MultirateSettings slow;
      slow.every.fill(3);
      CHECK(start(slow, late));
      CHECK(run_fault_tolerant<K>(robot, settings, fault_settings, cycles, state, prior.weighing(),
                                  fault_state, late) > 0);
    }
    {
      for (int i = 0; i < kDof<K>; ++i) robot.chain[i].torque_limit = 100;
      ControlSettings settings;
      CHECK(place_poles(robot, robot.home, 100, 1, settings));
      SafetyLimits limits;
      CHECK(default_limits(robot, settings, limits));
      FaultTolerantSettings fault_settings;
      prepare(fault_settings.monitor);
      FaultTolerantState fault_state;
      ControlState state;
      limits.tracking.fill(1);
      limits.deviation.fill(2);
      CHECK(run_safely<K>(robot, settings, limits, cycles, state, prior.weighing(), {}) > 0);
      const Monitored monitored{&fault_settings, &fault_state, nullptr};
      static_cast<void>(
          run_safely<K>(robot, settings, limits, cycles, state, prior.weighing(), monitored));
    }
    CHECK(run_models(robot, cycles) == 0);
    for (const double gate : {kGate, 0.0}) {
      OnlineCalibrator learner = prior.learner(robot);
      learner.settings.gate = gate;
      CHECK(run_learner<K>(learner, cycles) < 200);  // ξ̂ wanders: these poses belong to no robot
    }
  });
}

// Runs only when asked for: ctest expects the sanitizer to end the process.
TEST("[allocates] the sanitizer stops an allocation") {
  void* volatile block = nullptr;
  if (std::getenv("TRUEPOSE_ALLOCATE") != nullptr) block = allocate_in_real_time(100);
  CHECK(block == nullptr);
  std::free(block);
}
