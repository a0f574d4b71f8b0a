// A control path that neither allocates nor blocks. Two builds watch the same loops.
//
// test_realtime counts allocations by a hook on the allocator, over a million control cycles.
// Outside sanitizers the executable brings its own malloc family, which also serves operator new.
// AddressSanitizer owns those symbols and offers its own hook instead; it sees the same calls.
//
// test_nonblocking (preset `realtime`) is clang's: RealtimeSanitizer watches the loops run, and
// -Wfunction-effects, there an error, proves the same when compiling. clang infers the effects of
// functions it can see: the attribute on the loop covers all that a step calls.
#include <cstdlib>

#include "control/command.hpp"
#include "control/safe_control.hpp"
#include "control/safety_defaults.hpp"
#include "controllers.hpp"
#include "estimation/estimate.hpp"
#include "estimation/linearise.hpp"
#include "simulation/plant.hpp"

namespace {
volatile long allocations = 0;  // volatile: the compiler takes it that malloc changes no variable
}

#if defined(TRUEPOSE_NONBLOCKING) || defined(__SANITIZE_ADDRESS__)
constexpr long kCycles = 100000;
#else
constexpr long kCycles = 1000000;
#endif

#if defined(TRUEPOSE_NONBLOCKING)
#define NONBLOCKING [[clang::nonblocking]]
#elif defined(__SANITIZE_ADDRESS__)
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
#if !defined(NONBLOCKING)
#define NONBLOCKING
#endif

using namespace mechanisms;

namespace {

struct Cycle {
  Setpoint setpoint;
  Extended q_e;  ///< of a robot beside the setpoint
  Joint any;     ///< motors that mostly no pose has
};

/// A robot with two sensors, what is known of it, and cycles in a part of its box.
struct Scene {
  explicit Scene(const Mechanism& mechanism, double part = 1, Level level = Level::ideal)
      : robot(sensed(mechanism.robot, level)), prior(robot) {
    check::Random random(71);
    for (Cycle& cycle : cycles) {
      cycle.setpoint.x = random_pose(mechanism, random, part);
      cycle.setpoint.rate = random_joint(random, 0.5);
      cycle.setpoint.acceleration = random_joint(random, 5);
      cycle.any = random_joint(random, 3);
      Parasitic rest;
      const Pose beside =
          nearby(robot.mobility, to_pose(robot.mobility, cycle.setpoint.x), random, 1e-3 * part);
      CHECK(extended(level_of(robot), robot, beside, cycle.q_e, &rest));
    }
  }
  static Robot sensed(Robot robot, Level level) {
    robot.r = 2;
    robot.level = level;
    for (Chain& chain : robot.chain) chain.torque_limit = 100;
    return robot;
  }
  const Cycle& at(long k) const { return cycles[static_cast<std::size_t>(k) % cycles.size()]; }

  Robot robot;
  Prior prior;
  std::array<Cycle, 500> cycles;
};

template <class Step>
long looped(long count, const Step& step) noexcept NONBLOCKING {
  long times = 0;
  for (long k = 0; k < count; ++k) times += step(k);
  return times;
}

/// Runs step(0) to step(count - 1) in a watched loop. @return how many of them returned true
template <class Step>
long watched(long count, const Step& step) {
  const long before = allocations, times = looped(count, step);
  CHECK(allocations == before);
  return times;
}

}  // namespace

#if defined(TRUEPOSE_NONBLOCKING)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wfunction-effects"
/// What the sanitizer must stop: shows that it watches at all.
void* allocate_in_real_time(std::size_t size) noexcept NONBLOCKING { return std::malloc(size); }
#pragma clang diagnostic pop

// Runs only when asked for: ctest expects the sanitizer to end the process.
TEST("[allocates] the sanitizer stops an allocation") {
  void* volatile block = nullptr;
  if (std::getenv("TRUEPOSE_ALLOCATE") != nullptr) block = allocate_in_real_time(100);
  CHECK(block == nullptr);
  std::free(block);
}
#else
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
#endif

TEST_EACH(
    for_each,
    "no law allocates or blocks, in a million cycles with full feed-forward, nor rod by rod") {
  // All of the cycles for the paper's robot, a tenth for each of the others.
  const long many = check::sample_size(kCycles) / (K == Mobility::schoenflies ? 1 : 10);
  for (const Level level : {Level::ideal, Level::full}) {
    if (level == Level::full && !robot.full.own()) continue;
    const Scene made(mechanism, 1, level);
    Prior prior(made.robot);
    CachedGain kept;
    const Weighing fresh = prior.weighing(), keeps{fresh.known, fresh.work, &kept};
    const long count = level == Level::full ? 200 : many;
    for (const Law law : kLaws) {
      const ControlSettings settings = settings_for(made.robot, law);
      ControlState state;
      CHECK(watched(count, [&](long k) {
              // A pose twice, with weights of its own and with those that are kept.
              const Weighing& weighing = k / 2 % 2 == 0 ? fresh : keeps;
              const Cycle& at = made.at(k / 2);
              if (k % 20 == 0) {
                Extended wrong = at.q_e;
                wrong[0] += 3;  // mostly fails
                static_cast<void>(
                    control(made.robot, settings, at.setpoint, wrong, state, weighing));
              }
              return bool(control(made.robot, settings, at.setpoint, at.q_e, state, weighing));
            }) == count);
    }
  }
}

TEST_EACH(for_each, "no model does at either level, whether it finds an answer or not") {
  const Scene made(mechanism);
  const Robot& robot = made.robot;
  const bool full = robot.full.kind != FullKind::overconstrained;
  Robot copy = robot;
  const long count = kCycles / (K == Mobility::schoenflies ? 100 : 1000);
  CHECK(watched(count, [&](long k) {
          const Coordinates x = made.at(k).setpoint.x;
          Coordinates back = robot.home;
          const Pose pose = to_pose(robot.mobility, x);
          Joint q{};
          Extended q_e{};
          JointMatrix J;
          ExtendedColumns M;
          ExtendedRows M_plus;
          const bool ideal = ikm(Level::ideal, robot, x, q) &&
                             extended(Level::ideal, robot, pose, q_e) && tej(robot, x, M, M_plus) &&
                             command(Level::ideal, robot, x, q) &&
                             fkm(Level::ideal, robot, q, back);
          static_cast<void>(fkm(Level::ideal, robot, made.at(k).any, back));  // mostly fails
          back = robot.home;
          const bool rods = ikm(Level::full, robot, x, q) &&
                            extended(Level::full, robot, pose, q_e) &&
                            jacobian(Level::full, robot, x, J) && fkm(Level::full, robot, q, back);
          static_cast<void>(fkm(Level::full, robot, made.at(k).any, back));
          static_cast<void>(finish_full(copy));
          return ideal && rods == full;
        }) == count);
}

TEST_EACH(for_each, "no estimate does at either level, whether it finds a pose or not") {
  Scene made(mechanism);
  const Weighing by = made.prior.weighing();
  const auto estimated = [&](const Extended& q_e, Pose pose) {
    bool found = bool(estimate(Level::ideal, made.robot, *by.known, q_e, pose, by.work));
    if (paired(K))
      if (made.robot.full.kind == FullKind::exists)
        found = bool(estimate(Level::full, made.robot, *by.known, q_e, pose, by.work)) && found;
    return found;
  };
  CHECK(watched(300, [&](long k) {
          Extended q_e = made.at(k).q_e;
          const Pose near = to_pose(K, made.at(k).setpoint.x);
          const bool found = estimated(q_e, near);
          q_e[0] += 3;
          static_cast<void>(estimated(q_e, near));
          return found;
        }) == 300);
}

TEST_EACH(for_each, "no fault-tolerant controller does, whatever its readings do") {
  Scene made(mechanism, 1e-3);
  FaultTolerantSettings faults;
  faults.monitor.fastest.fill(500);
  faults.monitor.moved.fill(2e-3);
  prepare(faults.monitor);
  MultirateSettings slow;
  slow.every.fill(3);
  for (const bool is_slow : {false, true})
    for (const Law law : kLaws) {
      const ControlSettings settings = settings_for(made.robot, law);
      ControlState state;
      FaultTolerantState fault_state;
      PathClock clock;
      Multirate late;
      CHECK(start(slow, late));
      CHECK(watched(2000, [&](long k) {
              const int c = static_cast<int>(k / 50) % (readings(made.robot));
              Extended q_e = made.at(k).q_e;
              if (k % 50 > 40) q_e[c] = k % 100 > 50 ? NAN : q_e[c] + 1;
              if (k % 200 == 199) acknowledge(fault_state.monitor, c);
              clock.advance(settings.period, fault_state.stop);
              late.arrived = arrivals(late.settings, late.cycle);
              return control_fault_tolerant(
                         made.robot, settings, faults, clock.paced(made.at(k).setpoint), q_e, state,
                         made.prior.weighing(), fault_state, is_slow ? &late : nullptr)
                         .status == Status::disagree;
            }) > 100);
    }
}

TEST_EACH(for_each, "no safety shell does, whatever stops it, with a fault monitor and without") {
  Scene made(mechanism, 0);
  const ControlSettings settings = settings_for(made.robot, Law::joint);
  SafetyLimits limits;
  CHECK(default_limits(made.robot, settings, limits));
  limits.standstill = 0.05;
  FaultTolerantSettings faults;
  prepare(faults.monitor);
  for (const bool is_monitored : {false, true}) {
    FaultTolerantState fault_state;
    Monitored monitored;
    if (is_monitored) monitored = {&faults, &fault_state, nullptr};
    ControlState state;
    SafetyShell shell;
    long stops = 0;
    const long follows = watched(3000, [&](long k) {
      SafetyCycle cycle;
      cycle.request.acknowledge = k % 300 == 20;
      cycle.request.start = k % 300 == 21;
      if (k % 300 == 20 && is_monitored) acknowledge(fault_state, -1);
      Setpoint setpoint;
      setpoint.x = made.robot.home;
      Extended q_e = made.at(k).q_e;
      if (k % 300 > 100) q_e[0] = k % 600 > 300 ? NAN : 3;
      static_cast<void>(control_safely(made.robot, settings, limits, setpoint, q_e, state, shell,
                                       cycle, made.prior.weighing(), monitored));
      stops += shell.machine.state == SafetyState::fault;
      return shell.follows;
    });
    CHECK(is_monitored || follows > 100);
    CHECK(stops > 100);
  }
}

TEST_EACH(for_each, "no online calibrator does, at either level") {
  Scene made(mechanism);
  for (const double gate : {0.0, kGate}) {
    OnlineCalibrator learner = made.prior.learner(made.robot);
    learner.settings.gate = gate;
    watched(300, [&](long k) {
      Extended q_e = made.at(k).q_e;
      static_cast<void>(calibrate_online(learner, q_e));
      if (paired(K))
        if (made.robot.full.kind == FullKind::exists)
          static_cast<void>(calibrate_online(Level::full, learner, q_e));
      q_e[0] += 3;  // mostly fails
      return bool(calibrate_online(learner, q_e));
    });
    CHECK(gate > 0 ? learner.left_out > 5 : learner.lines > 250);
  }
}
