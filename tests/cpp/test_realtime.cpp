// Allocations in the control path. A hook on the allocator counts over a million cycles.
//
// Outside sanitizers the executable brings its own malloc family, which also serves operator new.
// AddressSanitizer owns those symbols and offers its own hook instead; it sees the same calls.
#include <cstdlib>

#include "mechanisms.hpp"
#include "truepose/control/safe_control.hpp"
#include "truepose/estimation/estimate.hpp"
#include "truepose/full/linearise.hpp"
#include "truepose/offline/plant.hpp"
#include "truepose/offline/safety_defaults.hpp"

namespace {
volatile long allocations = 0;  // volatile: the compiler takes it that malloc changes no variable
}

#if defined(__SANITIZE_ADDRESS__)
extern "C" int __sanitizer_install_malloc_and_free_hooks(  // gcc does not ship its header
    void (*on_malloc)(const volatile void*, std::size_t), void (*on_free)(const volatile void*));
static const int hook = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t) { allocations = allocations + 1; },
    [](const volatile void*) {});
#else
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void* malloc(std::size_t size) {
  allocations = allocations + 1;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  allocations = allocations + 1;
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  allocations = allocations + 1;
  return __libc_realloc(old, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  allocations = allocations + 1;
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** result, std::size_t alignment, std::size_t size) {
  *result = aligned_alloc(alignment, size);
  return *result == nullptr ? 12 /* ENOMEM */ : 0;
}
}
#endif

using namespace mechanisms;

TEST("the hook sees every way to allocate") {
  void* volatile kept = nullptr;  // volatile: the compiler may not leave the allocation out
  const auto counted = [&](auto allocate) {
    const long before = allocations;
    kept = allocate();
    const bool seen = allocations > before;
    std::free(kept);
    return seen;
  };
  CHECK(counted([] { return std::malloc(100); }));
  CHECK(counted([] { return std::calloc(10, 10); }));
  CHECK(counted([] { return std::realloc(nullptr, 100); }));
  CHECK(counted([] { return std::aligned_alloc(64, 128); }));
  CHECK(counted([] {
    void* result = nullptr;
    return posix_memalign(&result, 64, 128) == 0 ? result : nullptr;
  }));
  const long before = allocations;
  double* volatile block = new double[100];
  CHECK(allocations > before);
  delete[] block;
}

TEST("no law allocates in a million cycles with full feed-forward, and neither does the FKM") {
#if defined(__SANITIZE_ADDRESS__)
  const long cycles = check::sample_size(100000);
#else
  const long cycles = check::sample_size(1000000);
#endif
  for_each([&](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 2;
    Prior prior(robot);
    CachedGain kept;
    const Weighing fresh = prior.weighing(), keeps{fresh.known, fresh.work, &kept};
    // All of the cycles for the paper's robot, a tenth for each of the others.
    const long count = robot.mobility == Mobility::schoenflies ? cycles : cycles / 10;
    check::Random random(71);
    std::vector<Setpoint> setpoints(100);
    std::vector<Extended> readings(setpoints.size());
    for (std::size_t k = 0; k < setpoints.size(); ++k) {
      setpoints[k].x = random_pose(mechanism, random);
      setpoints[k].rate = random_joint(random, 0.5);
      setpoints[k].acceleration = random_joint(random, 5);
      CHECK(extended<K>(robot, nearby<K>(to_pose<K>(setpoints[k].x), random, 1e-3), readings[k]));
    }
    for (const Law law : kLaws) {
      ControlSettings settings;
      settings.law = law;
      CHECK(place_poles(robot, robot.home, 100, 1, settings));
      ControlState state;
      long failures = 0;
      const long before = allocations;
      for (long cycle = 0; cycle < count; ++cycle) {
        const std::size_t k = cycle % setpoints.size();
        // A pose twice, with weights of its own and with those that are kept.
        const Weighing& weighing = cycle / 2 % 2 == 0 ? fresh : keeps;
        if (!control(robot, settings, setpoints[k / 2], readings[k / 2], state, weighing))
          ++failures;
      }
      CHECK(allocations == before);
      CHECK(failures == 0);
    }
    long failures = 0;
    const long before = allocations;
    for (long cycle = 0; cycle < count / 10; ++cycle) {
      const std::size_t k = cycle % setpoints.size();
      Joint q{}, x = robot.home;
      for (int i = 0; i < kDof<K>; ++i) q[i] = readings[k][i];
      if (!fkm(robot, q, x)) ++failures;
      if (k == 0 && fkm(robot, random_joint(random, 3), x)) x = robot.home;  // mostly fails
    }
    CHECK(allocations == before);
    CHECK(failures == 0);
  });
}

TEST("the full level allocates nothing, whether it finds an answer or not") {
  for_each([&](const Mechanism& mechanism, auto) {
    const Robot& robot = mechanism.robot;
    const bool has_level = robot.full.kind != FullKind::overconstrained;
    check::Random random(72);
    Robot copy = robot;
    long failures = 0;
    const long before = allocations;
    for (long k = 0; k < 300; ++k) {
      const Joint x = random_pose(mechanism, random);
      Joint q{}, back = robot.home;
      Reading r;
      JointMatrix J;
      const bool ok = ikm_full(robot, x, q) && rkm_full(robot, x, r) &&
                      jacobian_full(robot, x, J) && fkm_full(robot, q, back);
      if (ok != has_level) ++failures;
      static_cast<void>(fkm_full(robot, random_joint(random, 3), back));  // mostly fails
      static_cast<void>(finish_full(copy));
    }
    CHECK(allocations == before);
    CHECK(failures == 0);
  });
}

TEST("the estimate allocates nothing at either level, whether it finds a pose or not") {
  for_each([&](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 2;
    std::vector<int> column;
    for (int i = 0; i < dof(robot.mobility); ++i)
      for (int k = 0; k < 3; ++k) column.push_back(chain_column(i) + k);
    const int p = static_cast<int>(column.size());
    std::vector<double> root(p * p), work(estimate_work(robot, p));
    for (int k = 0; k < p; ++k) root[k * p + k] = 3e-4;
    Knowledge known{p, column.data(), root.data(), {}};
    known.sigma.fill(1e-4);
    check::Random random(73);
    long failures = 0;
    const long before = allocations;
    for (long k = 0; k < 300; ++k) {
      const Pose at = to_pose<K>(random_pose(mechanism, random));
      Extended q_e;
      if (!extended<K>(robot, at, q_e)) ++failures;
      Pose pose = nearby<K>(at, random, 1e-3);
      if (!estimate<K>(robot, known, q_e, pose, work.data())) ++failures;
      if constexpr (kPaired<K>)
        if (robot.full.kind == FullKind::exists &&
            !estimate<K, FullModel>(robot, known, q_e, pose, work.data()))
          ++failures;
      q_e[0] += 3;  // mostly fails
      static_cast<void>(estimate<K>(robot, known, q_e, pose, work.data()));
    }
    CHECK(allocations == before);
    CHECK(failures == 0);
  });
}

TEST("control allocates nothing where the robot is understood rod by rod, under every law") {
  for (const Mechanism& mechanism : {h4(), par4(), delta()})
    with_mobility(mechanism.robot.mobility, [&](auto mobility) {
      constexpr Mobility K = mobility();
      if constexpr (kPaired<K>) {
        Robot robot = mechanism.robot;
        robot.r = std::max(robot.r, 1);
        robot.level = Level::full;
        CHECK(robot.rod_by_rod());
        Prior prior(robot);
        check::Random random(75);
        long failures = 0;
        for (const Law law : kLaws) {
          ControlSettings settings;
          settings.law = law;
          CHECK(place_poles(robot, robot.home, 150, 1, settings));
          ControlState state;
          const long before = allocations;
          for (long k = 0; k < 200; ++k) {
            Setpoint setpoint;
            setpoint.x = random_pose(mechanism, random);
            Extended q_e;
            Parasitic rest;
            if (!exact_readings<K>(robot, nearby<K>(to_pose<K>(setpoint.x), random, 1e-4), q_e,
                                   rest) ||
                !control<K>(robot, settings, setpoint, q_e, state, prior.weighing()))
              ++failures;
            q_e[0] += 3;  // mostly fails
            static_cast<void>(control<K>(robot, settings, setpoint, q_e, state, prior.weighing()));
          }
          CHECK(allocations == before);
        }
        CHECK(failures == 0);
      }
    });
}

TEST("a fault-tolerant controller allocates nothing, whatever its readings do") {
  for_each([&](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 2;
    Prior prior(robot);
    FaultTolerantSettings fault_settings;
    fault_settings.monitor.fastest.fill(500);
    fault_settings.monitor.moved.fill(2e-3);
    prepare(fault_settings.monitor);
    for (const Law law : kLaws) {
      ControlSettings settings;
      settings.law = law;
      CHECK(place_poles(robot, robot.home, 100, 1, settings));
      ControlState state;
      FaultTolerantState fault_state;
      check::Random random(76);
      long faults = 0;
      const long before = allocations;
      for (long k = 0; k < 2000; ++k) {
        Setpoint setpoint;
        setpoint.x = random_pose(mechanism, random, 1e-3);
        Extended q_e;
        if (!extended<K>(robot, to_pose<K>(setpoint.x), q_e)) continue;
        const int c = static_cast<int>(k / 50) % (kDof<K> + robot.r);
        if (k % 50 > 40) q_e[c] = k % 100 > 50 ? NAN : q_e[c] + 1;
        if (k % 200 == 199) acknowledge(fault_state.monitor, c);
        const Outcome outcome = control_fault_tolerant<K>(
            robot, settings, fault_settings, setpoint, q_e, state, prior.weighing(), fault_state);
        if (outcome.status == Status::disagree) ++faults;
      }
      CHECK(allocations == before);
      CHECK(faults > 100);
    }
  });
}

TEST("the safety shell allocates nothing, whatever stops it") {
  for_each([&](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    for (int i = 0; i < kDof<K>; ++i) robot.chain[i].torque_limit = 100;
    Prior prior(robot);
    ControlSettings settings;
    CHECK(place_poles(robot, robot.home, 100, 1, settings));
    SafetyLimits limits;
    CHECK(default_limits(robot, settings, limits));
    limits.standstill = 0.05;
    Setpoint setpoint;
    setpoint.x = robot.home;
    Extended q_e{};
    CHECK(extended<K>(robot, to_pose<K>(robot.home), q_e));
    ControlState state;
    SafetyShell shell;
    long runs = 0, faults = 0;
    const long before = allocations;
    for (long k = 0; k < 3000; ++k) {
      SafetyCycle cycle;
      cycle.request.acknowledge = k % 300 == 20;
      cycle.request.start = k % 300 == 21;
      Extended read = q_e;
      if (k % 300 > 100) read[0] = k % 600 > 300 ? NAN : 3;
      static_cast<void>(control_safely<K>(robot, settings, limits, setpoint, read, state, shell,
                                          cycle, prior.weighing()));
      runs += shell.follows;
      faults += shell.machine.state == SafetyState::fault;
    }
    CHECK(allocations == before);
    CHECK(runs > 100 && faults > 100);
  });
}

TEST("learning while it works, a controller allocates nothing, at either level") {
  for_each([&](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 2;
    for (const double gate : {0.0, kGate}) {
      Prior prior(robot);
      OnlineCalibrator learner = prior.learner(robot);
      learner.settings.gate = gate;
      check::Random random(74);
      const long before = allocations;
      for (long k = 0; k < 300; ++k) {
        Extended q_e;
        if (!extended<K>(robot, to_pose<K>(random_pose(mechanism, random)), q_e)) continue;
        static_cast<void>(calibrate_online<K>(learner, q_e));
        if constexpr (kPaired<K>)
          if (robot.full.kind == FullKind::exists)
            static_cast<void>(calibrate_online<K, FullModel>(learner, q_e));
        q_e[0] += 3;  // mostly fails
        static_cast<void>(calibrate_online<K>(learner, q_e));
      }
      CHECK(allocations == before);
      CHECK(gate > 0 ? learner.left_out > 5 : learner.lines > 250);
    }
  });
}
