// The safety shell by itself, told what it is to believe: every limit, every state with every
// reading, and hostile cycles.
#include <functional>

#include "controllers.hpp"
#include "truepose/control/trajectory.hpp"
#include "truepose/offline/safety_defaults.hpp"

using namespace mechanisms;

namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr long kHostile = 300'000;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
constexpr long kHostile = 300'000;
#else
constexpr long kHostile = 10'000'000;
#endif
#else
constexpr long kHostile = 10'000'000;
#endif

/// Limits, a shell, and a robot that follows its path exactly, but for counts.
template <Mobility K>
struct Guarded {
  static constexpr int n = kDof<K>;
  explicit Guarded(const Mechanism& mechanism) : robot(mechanism.robot) {
    CHECK(inverse_dynamics<K>(robot, to_pose<K>(robot.home), {}, {}, weight));
    ControlSettings one;
    CHECK(place_poles(robot, robot.home, 1, 1, one));  // kp: the motors' inertia
    for (int i = 0; i < n; ++i) {
      robot.chain[i].torque_limit = 4 * std::fabs(weight[i]) + 200 * one.kp[i];
      robot.chain[i].encoder_step = 1e-5;
    }
    CHECK(default_limits(robot, settings_for(robot, Law::joint), limits));
  }

  /// The next healthy cycle: the path goes on while the law acts.
  SafetyCycle healthy() {
    if (shell.follows) time += limits.period;
    SafetyCycle cycle;
    cycle.x = robot.home;
    for (int j = 0; j < n; ++j) cycle.x[j] += 0.01 * (1 - std::cos((3 + j) * time));
    Closure<K> closure;
    CHECK(ikm<K>(robot, to_pose<K>(cycle.x), closure));
    cycle.q_d = closure.q();
    for (int i = 0; i < n; ++i) cycle.q[i] = quantized(cycle.q_d[i], robot.chain[i].encoder_step);
    cycle.torque = cycle.load = weight;
    cycle.counter = {true, ++frame};
    cycle.time = {true, 1'000'000 * frame};
    cycle.request = request;
    return cycle;
  }

  /// One cycle, and what holds in every one.
  void step(const SafetyCycle& cycle) {
    const SafetyShell before = shell;
    guard<K>(robot, limits, cycle, shell);
    const SafetyState from = before.machine.state, state = shell.machine.state;
    const bool closed = from != SafetyState::running && from != SafetyState::stopping;
    for (int i = 0; i < n; ++i) {
      const double torque = shell.torque[i], last = before.torque[i], holds = shell.weight[i];
      CHECK(std::fabs(torque) <= limits.torque[i]);
      CHECK(std::fabs(torque - last) <= limits.slew[i] * limits.period * (1 + 1e-9));
      if (!shell.brakes) continue;
      // Towards the holding torque or zero; and never beyond it against a closed brake.
      CHECK(torque >= std::min({last, holds, 0.0}) && torque <= std::max({last, holds, 0.0}));
      if (closed)
        CHECK(std::fabs(torque) <= std::max(std::fabs(holds), std::fabs(before.weight[i])));
    }
    CHECK(shell.brakes == 0 || shell.brakes == bit(n) - 1);
    if (shell.brakes == 0)
      CHECK(state == SafetyState::running || shell.machine.stop == StopKind::path);
    const bool acknowledged = cycle.request.acknowledge && !before.acknowledged;
    const bool started = cycle.request.start && !before.started;
    if (state == SafetyState::running && from != SafetyState::running)
      CHECK(from == SafetyState::ready && started);
    if (state == SafetyState::ready && from != SafetyState::ready)
      CHECK(acknowledged && shell.causes == 0);
    if (from == SafetyState::fault && state == SafetyState::fault)
      CHECK(shell.cause == before.cause && (shell.causes & before.causes) == before.causes);
    if (state == SafetyState::fault || shell.machine.violated)
      CHECK(shell.causes != 0 && shell.cause != StopCause::none);
    if (shell.follows) CHECK(shell.brakes == 0);
    CHECK((shell.path_stop > 0) == (shell.machine.stop == StopKind::path));
  }
  void run_for(int count) {
    for (int k = 0; k < count; ++k) step(healthy());
  }
  /// By buttons that are let go.
  void press(bool SafetyRequests::* button) {
    request.*button = true;
    run_for(1);
    request.*button = false;
  }
  void to_ready() {
    run_for(10);
    press(&SafetyRequests::acknowledge);
    CHECK(shell.machine.state == SafetyState::ready);
  }
  void to_running() {
    to_ready();
    press(&SafetyRequests::start);
    CHECK(shell.machine.state == SafetyState::running);
    run_for(60);
    CHECK(shell.follows && shell.machine.state == SafetyState::running);
  }
  /// Cycles from now on until it stops. @param change  change(cycle, number of the cycle)
  template <class Change>
  int until_stop(int most, Change&& change) {
    for (int k = 1; k <= most; ++k) {
      SafetyCycle cycle = healthy();
      change(cycle, k);
      step(cycle);
      if (shell.machine.state != SafetyState::running) return k;
    }
    return -1;
  }

  Robot robot;
  SafetyLimits limits;
  SafetyShell shell;
  SafetyRequests request;
  Joint weight{};
  double time = 0;
  std::uint64_t frame = 0;
};

template <class F>
void for_three(F&& f) {
  const auto one = [&](const Mechanism& mechanism, auto mobility) {
    check::state().scene = mechanism.name;
    f(mechanism, mobility);
  };
#ifdef CHECK_MOBILITY
  for_each(one);
#else
  one(h4(), Fixed<Mobility::schoenflies>{});
  one(delta(), Fixed<Mobility::translation>{});
  one(hexapod("6-UPS", Actuator::telescopic), Fixed<Mobility::spatial>{});
#endif
}

}  // namespace

TEST("a healthy robot runs for as long as it may") {
  for_three([](const Mechanism& mechanism, auto mobility) {
    Guarded<mobility()> scene(mechanism);
    scene.to_running();
    scene.run_for(3000);
    CHECK(scene.shell.follows && scene.shell.causes == 0);
    CHECK(scene.shell.counter.jitter == 0 && scene.shell.time.jitter < 1e-9);
  });
}

TEST("every violation stops a running robot for its cause, within 10 ms of what its limit allows") {
  for_three([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    using Change = std::function<void(SafetyCycle&, int)>;
    Guarded<K> scene(mechanism);
    scene.limits.low.fill(-1e3);
    scene.limits.high.fill(1e3);
    for (int j = 0; j < kDof<K>; ++j) {
      scene.limits.box_low[j] = mechanism.robot.home[j] - 0.03;
      scene.limits.box_high[j] = mechanism.robot.home[j] + 0.03;
    }
    scene.to_running();
    const SafetyLimits& limits = scene.limits;
    const double per_cycle = limits.speed[0] * limits.period;
    const int saturation = static_cast<int>(limits.saturation / limits.period) + 2;
    struct Case {
      StopCause cause;
      int within;
      StopKind stop;
      Change change;
    };
    const SafetyCycle last = scene.healthy();
    std::vector<Case> cases{
        {StopCause::tracking_error, 1, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.error[0] = 1.01 * limits.tracking[0]; }},
        {StopCause::tracking_error, 1, StopKind::brake,
         [&](SafetyCycle& cycle, int k) {
           cycle.error[0] = 0;
           cycle.q_d[0] += k * 0;
           cycle.q[0] += 0;
           cycle.error[1] = -1.01 * limits.tracking[1];
         }},
        {StopCause::overspeed, 10, StopKind::brake,
         [&](SafetyCycle& cycle, int k) {
           for (Joint* of : {&cycle.q, &cycle.q_d}) (*of)[0] += 1.2 * per_cycle * k;
           cycle.q_d[0] = cycle.q[0] - 0.9 * limits.deviation[0];  // the setpoint is no witness
         }},
        {StopCause::setpoint_speed, 1, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.q_d[0] += 1.5 * per_cycle; }},
        {StopCause::saturation, saturation, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.torque[0] = limits.torque[0]; }},
        {StopCause::torque_rate, 12, StopKind::brake,
         [&](SafetyCycle& cycle, int k) {
           cycle.torque[0] = (k % 2 ? 0.9 : -0.9) * limits.torque[0];
         }},
        {StopCause::motor_range, 1, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.q[0] = 1.1e3; }},
        {StopCause::missing_reading, 6, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.q[0] = NAN; }},
        {StopCause::missing_reading, 6, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.q[kDof<K> - 1] = 1e300; }},
        {StopCause::stale_frame, 3, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.counter = last.counter; }},
        {StopCause::stale_frame, 3, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.time = last.time; }},
        {StopCause::stale_frame, 3, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.counter = {}; }},
        {StopCause::dropped_frames, 1, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.counter.value += 4; }},
        {StopCause::clock_backwards, 1, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.time.value -= 3'000'000; }},
        {StopCause::clock_backwards, 1, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.counter.value -= 2; }},
        {StopCause::suspected_motor, 1, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.lost = true; }},
        {StopCause::readings_disagree, 1, StopKind::path,
         [](SafetyCycle& cycle, int) { cycle.disagree = true; }},
        {StopCause::no_answer, 6, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.answer = {Status::singular, -1}; }},
        {StopCause::unknown_pose, 1, StopKind::brake,
         [](SafetyCycle& cycle, int) { cycle.known = false; }},
        {StopCause::workspace, 1, StopKind::path,
         [](SafetyCycle& cycle, int) { cycle.x[0] += 0.04; }},
        {StopCause::requested, 1, StopKind::path,
         [](SafetyCycle& cycle, int) { cycle.request.stop = true; }},
        {StopCause::requested, 1, StopKind::brake,
         [](SafetyCycle& cycle, int) {
           cycle.request.stop = true;
           cycle.suspected = 1;
         }},
    };
    for (const Case& one : cases) {
      Guarded<K> copy = scene;
      const int within = copy.until_stop(one.within + 5, one.change);
      const bool right = copy.shell.cause == one.cause && copy.shell.machine.stop == one.stop &&
                         within > 0 && within <= one.within;
      CHECK(right);
      if (!right)
        std::printf("  %s: %s after %d cycles, stop %d\n", properties(one.cause).name,
                    properties(copy.shell.cause).name, within,
                    static_cast<int>(copy.shell.machine.stop));
      // What happens then is known: brakes, holding torque, zero; latched.
      for (int k = 0; k < 300; ++k) copy.step(copy.healthy());
      CHECK(copy.shell.machine.state ==
            (one.cause == StopCause::requested ? SafetyState::stopped : SafetyState::fault));
      for (int i = 0; i < kDof<K>; ++i) CHECK(copy.shell.torque[i] == 0);
      CHECK(copy.shell.brakes == bit(kDof<K>) - 1 && copy.shell.cause == one.cause);
    }
  });
}
