// Loops of the control path, watched for allocations (test_realtime.cpp): once in an executable.
#pragma once

#include <cstdlib>

#include "control/command.hpp"
#include "control/fault_tolerant_control.hpp"
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
