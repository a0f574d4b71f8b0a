// A control path that neither allocates nor blocks. Two builds watch the same loops.
//
// test_realtime counts allocations by a hook on the allocator, over a million control cycles.
// Outside sanitizers the executable brings its own malloc family, which also serves operator new.
// AddressSanitizer owns those symbols and offers its own hook instead; it sees the same calls.
//
// test_nonblocking (preset `realtime`) is clang's: RealtimeSanitizer watches the loops run, and
// -Wfunction-effects, there an error, proves the same when compiling. clang infers the effects of
// functions it can see: the attribute on the loop covers all that a step calls.
#include "realtime.hpp"

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

TEST_EACH(for_each, "no online calibrator does, at either level") {
  Scene made(mechanism);
  std::vector<Real> root;  // of the first: the gated one begins with what it knows
  for (const double gate : {0.0, kGate}) {
    OnlineCalibrator learner = made.prior.learner(made.robot);
    std::copy(root.begin(), root.end(), learner.state.root);
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
    root.assign(learner.state.root, learner.state.root + learner.state.count * learner.state.count);
  }
  OnlineCalibrator follower = made.prior.follower(made.robot);
  watched(300, [&](long k) {
    Extended q_e = made.at(k).q_e;
    if (k > 100) q_e[0] += 1e-3;
    return bool(calibrate_online(follower, q_e));
  });
}
