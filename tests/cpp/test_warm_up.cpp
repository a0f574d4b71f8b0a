// Warm-up: slow growth of base, arms and rods is a state, faster or larger growth a fault.
#include "control/fault_monitor.hpp"
#include "mechanism/geometry.hpp"
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {

constexpr double kPeriod = 0.02, kGrowth = 5e-3;
constexpr int kMemory = 100;          ///< cycles
constexpr int kSlow = 320 * kMemory;  ///< within a memory no robot's readings see the growth

/// A robot that grows on its way, and a monitor with the model of the cold robot.
class Growing {
 public:
  explicit Growing(const Mechanism& mechanism) : cold_(mechanism.robot), grown_(cold_) {
    cold_.r = grown_.r = 2;
    known_.sigma.fill(1e-5);
    work_.resize(static_cast<std::size_t>(estimate_work(cold_, 0)));
    xi_.resize(static_cast<std::size_t>(parameter_count(cold_)));
    CHECK(drawn_parameters(cold_, xi_.data()));  // which has one c for both pivots of a bar
    CHECK(set_parameters(grown_, xi_.data(), cold_));
    settings.period = kPeriod;
    settings.growth.fill(kGrowth);
    settings.memory = kMemory * kPeriod;
    settings.refresh = 4;
    prepare(settings);
  }
  /// One cycle. @param share  growth of base and arms over kGrowth @return whether it is healthy
  bool cycle(double share) {
    Coordinates x = cold_.home;
    for (int i = 0; i < dof(cold_.mobility); ++i) x[i] += 0.02 * std::sin(0.002 * cycle_ * (3 + i));
    ++cycle_;
    CHECK(drawn_parameters(cold_, xi_.data()));
    for (int i = 0; i < cold_.chains; ++i)
      for (int k = 0; k <= static_cast<int>(ChainParameter::arm); ++k)  // else all angles stay
        xi_[static_cast<std::size_t>(chain_column(i) + k)] *= 1 + share * kGrowth;
    CHECK(set_parameters(cold_, xi_.data(), grown_));
    Extended q_e{}, believed{};
    CHECK(extended(Level::ideal, grown_, to_pose(cold_.mobility, x), q_e));
    const Joint desired = motors_of(cold_, q_e);
    return monitor_faults(cold_, settings, {&known_, work_.data()}, desired, q_e, seen, believed)
               .status == Status::ok;
  }
  /// Grows from one share to another. @return whether it is healthy all the while
  bool grows(double from, double to, int cycles) {
    bool healthy = true;
    for (int k = 0; k < cycles && healthy; ++k) healthy = cycle(from + (to - from) * k / cycles);
    return healthy;
  }

  FaultMonitorSettings settings;
  FaultMonitor seen;

 private:
  Robot cold_, grown_;
  Knowledge known_;
  std::vector<double> work_, xi_;
  int cycle_ = 0;
};
}  // namespace

TEST("slow growth is a warm-up; the same growth at once, or more of it, is a fault") {
  int grown = 0;
  // What redundant motors disagree by after a growth is of second order in the parity.
  for_each_square([&](const Mechanism& mechanism) {
    Growing blind(mechanism), slow(mechanism), fast(mechanism), large(mechanism);
    blind.settings.growth.fill(0);
    if (blind.grows(0, 0.9, kSlow)) return;  // this robot's sensors do not see it
    ++grown;
    CHECK(slow.grows(0, 0.9, kSlow));
    CHECK(slow.seen.warm_up.warm);
    CHECK(slow.grows(0.9, 0, kSlow));
    CHECK(slow.grows(0, 0, 3 * kMemory));
    CHECK(!slow.seen.warm_up.warm);

    CHECK(fast.grows(0, 0, 3 * kMemory));
    CHECK(!fast.seen.warm_up.warm);
    CHECK(!fast.grows(0, 0.9, kMemory / 5));
    CHECK(!large.grows(0, 5, 200 * kMemory));
  });
  CHECK(grown > 0);
}

TEST_EACH(for_each_square, "a robot that is switched on warm is warm, and healthy") {
  Growing robot(mechanism);
  CHECK(robot.grows(0.9, 0.9, kSlow));
}
