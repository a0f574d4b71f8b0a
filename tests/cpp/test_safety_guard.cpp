// The safety shell by itself, told what it is to believe: every limit, every state with every
// reading, and hostile cycles.
#include <functional>

#include "controllers.hpp"
#include "rotational.hpp"
#include "truepose/control/trajectory.hpp"
#include "truepose/offline/safety_defaults.hpp"

using namespace pivots_tested;

namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr long kHostile = 2'000'000;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
constexpr long kHostile = 2'000'000;
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
  /// Cycles that any stop takes.
  int rest() const {
    return static_cast<int>((limits.stop + limits.brake + limits.standstill) / limits.period) + 20;
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

/// Robots of one to six motors.
template <class F>
void for_some(F&& f) {
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
  one(g1_ankle(), Fixed<Mobility::rotational_2>{});
  one(lever(), Fixed<Mobility::rotational_1>{});
#endif
}

}  // namespace

TEST("a healthy robot runs for as long as it may") {
  for_some([](const Mechanism& mechanism, auto mobility) {
    Guarded<mobility()> scene(mechanism);
    scene.to_running();
    scene.run_for(3000);
    CHECK(scene.shell.follows && scene.shell.causes == 0);
    CHECK(scene.shell.counter.jitter == 0 && scene.shell.time.jitter < 1e-9);
  });
}

TEST("every violation stops a running robot for its cause, within 10 ms beyond its own time") {
  for_some([](const Mechanism& mechanism, auto mobility) {
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
    const int drift = static_cast<int>(std::ceil(limits.deviation[0] / (0.8 * per_cycle)));
    struct Case {
      StopCause cause;
      int within;
      StopKind stop;
      Change change;
    };
    const FrameMark counter{true, scene.frame}, stamp{true, 1'000'000 * scene.frame};
    std::vector<Case> cases{
        {StopCause::tracking_error, 1, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.error[0] = 1.01 * limits.tracking[0]; }},
        {StopCause::tracking_error, 1, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.error[kDof<K> - 1] = NAN; }},
        {StopCause::tracking_error, drift + 1, StopKind::brake,
         [&](SafetyCycle& cycle, int k) { cycle.q[0] += 0.8 * per_cycle * k; }},
        {StopCause::overspeed, 10, StopKind::brake,
         [&](SafetyCycle& cycle, int k) {
           cycle.q[0] += 1.2 * per_cycle * k;
           cycle.q_d[0] += 0.9 * per_cycle * k;
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
         [&](SafetyCycle& cycle, int) { cycle.counter = counter; }},
        {StopCause::stale_frame, 3, StopKind::brake,
         [&](SafetyCycle& cycle, int) { cycle.time = stamp; }},
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
      copy.run_for(copy.rest());
      CHECK(copy.shell.machine.state ==
            (one.cause == StopCause::requested ? SafetyState::stopped : SafetyState::fault));
      for (int i = 0; i < kDof<K>; ++i) CHECK(copy.shell.torque[i] == 0);
      CHECK(copy.shell.brakes == bit(kDof<K>) - 1 && copy.shell.cause == one.cause);
    }
  });
}

TEST("bad input has one status each, and nothing moves") {
  for_some([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    using Change = std::function<void(Guarded<K>&, SafetyCycle&)>;
    const auto cause = [](auto set) {
      return [=](Guarded<K>&, SafetyCycle& cycle) { set(cycle); };
    };
    const std::vector<std::pair<StopCause, Change>> cases{
        {StopCause::unknown_pose, cause([](SafetyCycle& cycle) { cycle.known = false; })},
        {StopCause::missing_reading, cause([](SafetyCycle& cycle) { cycle.q[0] = NAN; })},
        {StopCause::no_answer,
         cause([](SafetyCycle& cycle) { cycle.answer = {Status::unreachable, 0}; })},
        {StopCause::tracking_error, cause([](SafetyCycle& cycle) { cycle.error[0] = 10; })},
        {StopCause::clock_backwards,
         [](Guarded<K>& scene, SafetyCycle& cycle) {
           cycle.time.value = 5'000'000 - 1'000 * scene.frame;
         }},
        {StopCause::stale_frame, cause([](SafetyCycle& cycle) {
           cycle.counter.value = std::min<std::uint64_t>(cycle.counter.value, 20);
         })},
        {StopCause::requested, cause([](SafetyCycle& cycle) { cycle.request.stop = true; })},
        {StopCause::contradictory_limits,
         [](Guarded<K>& scene, SafetyCycle&) { scene.limits.still[0] = 0; }},
        {StopCause::contradictory_limits,
         [](Guarded<K>& scene, SafetyCycle&) { scene.limits.speed[0] = NAN; }},
        {StopCause::contradictory_limits,
         [](Guarded<K>& scene, SafetyCycle&) { scene.limits.window = 9; }},
    };
    for (const auto& [why, change] : cases) {
      for (const bool start : {false, true}) {  // an acknowledgement is refused, and a start
        Guarded<K> scene(mechanism);
        if (start) scene.to_ready();
        StopCause refused = StopCause::none;
        for (int k = 0; k < 60; ++k) {
          SafetyCycle cycle = scene.healthy();
          change(scene, cycle);
          const bool asks = k == 50;
          (start ? cycle.request.start : cycle.request.acknowledge) = asks;
          scene.step(cycle);
          if (asks) refused = scene.shell.refused;
          CHECK(scene.shell.brakes == bit(kDof<K>) - 1 && !scene.shell.follows);
          for (int i = 0; i < kDof<K>; ++i) CHECK(scene.shell.torque[i] == 0);
        }
        // In `ready` what always counts is a fault at once, in which a start is refused as such.
        CHECK(refused == why);
        if (refused != why)
          std::printf("  %s: %s\n", properties(why).name, properties(refused).name);
        const bool fault = properties(why).always;
        CHECK(scene.shell.machine.state == (fault   ? SafetyState::fault
                                            : start ? SafetyState::ready
                                                    : SafetyState::stopped));
        if (fault) CHECK(scene.shell.cause == why);
      }
    }
  });
}

TEST("a fault is left only by an acknowledgement without its cause, and a start that is new") {
  for_some([](const Mechanism& mechanism, auto mobility) {
    Guarded<mobility()> scene(mechanism);
    scene.to_running();
    SafetyShell& shell = scene.shell;
    const auto lose = [](SafetyCycle& cycle, int) { cycle.lost = true; };
    CHECK(scene.until_stop(1, lose) == 1);
    scene.run_for(scene.rest());
    CHECK(shell.machine.state == SafetyState::fault && shell.cause == StopCause::suspected_motor);
    scene.request.start = true;  // held from here on
    scene.run_for(3);
    CHECK(shell.machine.state == SafetyState::fault);
    SafetyCycle persists = scene.healthy();
    persists.lost = persists.request.acknowledge = true;
    scene.step(persists);
    CHECK(shell.machine.state == SafetyState::fault && shell.refused == StopCause::suspected_motor);
    scene.request.acknowledge = true;  // also held: it began while the cause persisted
    scene.run_for(20);
    CHECK(shell.machine.state == SafetyState::fault);
    scene.request.acknowledge = false;
    scene.run_for(1);
    scene.press(&SafetyRequests::acknowledge);
    CHECK(shell.machine.state == SafetyState::ready && shell.cause == StopCause::none);
    scene.run_for(20);
    CHECK(shell.machine.state == SafetyState::ready);
    scene.request.start = false;
    scene.run_for(1);
    scene.press(&SafetyRequests::start);
    CHECK(shell.machine.state == SafetyState::running);
    scene.run_for(100);
    CHECK(shell.follows && shell.causes == 0);
    scene.press(&SafetyRequests::stop);
    CHECK(shell.machine.stop == StopKind::path && shell.path_stop == scene.limits.stop);
    scene.run_for(scene.rest());
    CHECK(shell.machine.state == SafetyState::stopped && shell.cause == StopCause::requested);
    scene.press(&SafetyRequests::start);
    CHECK(shell.refused == StopCause::not_ready && shell.machine.state == SafetyState::stopped);
  });
}

TEST("every state with every reading: healthy, implausible, missing, contradictory") {
  for_some([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    // Every state that can be reached, and the releasing of the brakes.
    std::vector<Guarded<K>> states(1, Guarded<K>(mechanism));
    states[0].run_for(10);
    const auto add = [&](bool SafetyRequests::* button, int cycles) {
      states.push_back(states.back());
      if (button) states.back().press(button);
      states.back().run_for(cycles);
    };
    add(&SafetyRequests::acknowledge, 2);  // ready
    add(&SafetyRequests::start, 3);        // torque rises, brakes hold
    add(nullptr, 12);                      // brakes open
    add(nullptr, 60);                      // the law acts
    const Guarded<K> runs = states.back();
    add(&SafetyRequests::stop, 5);  // stops on its path
    add(nullptr, 160);              // brakes close
    add(nullptr, runs.rest());      // stopped
    states.push_back(runs);
    CHECK(states.back().until_stop(1, [](SafetyCycle& cycle, int) { cycle.lost = true; }) == 1);
    add(nullptr, runs.rest());  // fault
    std::uint32_t seen = 0;
    for (const Guarded<K>& state : states) {
      seen |= 1U << static_cast<int>(state.shell.machine.state);
      for (int reading = -1; reading <= n; ++reading)  // none, each motor's, all
        for (int kind = 0; kind < 4; ++kind)
          for (int requests = 0; requests < 8; ++requests) {
            Guarded<K> copy = state;
            const bool fault = copy.shell.machine.state == SafetyState::fault;
            bool acknowledged = false;
            for (int k = 0; k < 40; ++k) {
              SafetyCycle cycle = copy.healthy();
              for (int i = 0; i < n; ++i) {
                if (i != reading && reading != n) continue;
                if (kind == 1) cycle.q[i] += 3;
                if (kind == 2) cycle.q[i] = NAN;
                if (kind == 3) cycle.suspected |= bit(i);
                if (kind == 3) cycle.error[i] = -1.1 * copy.limits.tracking[i];
              }
              const bool now = k == 5 || k == 20;
              cycle.request = {now && requests & 1, k >= 5 && requests & 2, now && requests & 4};
              copy.step(cycle);
              acknowledged = acknowledged || cycle.request.acknowledge;
              if (fault && !acknowledged) CHECK(copy.shell.machine.state == SafetyState::fault);
              const bool bad = reading >= 0 && kind > 0;
              if (bad && k > 10) CHECK(!copy.shell.follows);
            }
          }
    }
    CHECK(seen == 0x1f);
  });
}

TEST("hostile cycles of any numbers, clocks and requests break no promise") {
  for_some([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Guarded<K> scene(mechanism);
    std::mt19937_64 random(11);
    constexpr double kBad[]{NAN, INFINITY, -INFINITY, 1e308, -1e300, 1e9, 0, 1e-320};
    SafetyCycle cycle = scene.healthy();
    const long count = check::sample_size(kHostile / 5);
    std::array<long, 5> in{};
    long follows = 0;
    for (long k = 0; k < count; ++k) {
      const std::uint64_t bits = random();
      const bool calm = (k >> 8) % 3 != 0;  // else it would hardly ever run
      ++cycle.counter.value;
      cycle.time.value += 1'000'000;
      cycle.request = {(bits & 15) == 0, false, (bits >> 4 & 15) == 0};
      if ((bits >> 8 & 31) == 0 && k % 16 == 0) cycle = scene.healthy();
      if (!calm && (bits >> 13 & 7) == 0) {
        const double bad = bits >> 16 & 1
                               ? kBad[bits >> 17 & 7]
                               : static_cast<double>(static_cast<std::int64_t>(random())) /
                                     static_cast<double>(1ULL << (bits >> 20 & 63));
        Joint* const joints[]{&cycle.q, &cycle.q_d, &cycle.torque, &cycle.load, &cycle.error};
        const int which = static_cast<int>(bits >> 32 & 7), i = static_cast<int>((bits >> 35) % n);
        if (which < 5) (*joints[which])[static_cast<std::size_t>(i)] = bad;
        if (which == 5) cycle.x[static_cast<std::size_t>(i)] = bad;
        if (which == 6) cycle.counter.value += bits >> 40 & 7 ? bits >> 61 : bits;
        if (which == 7) cycle.time.value -= bits >> 40 & 7 ? 0 : bits;
        cycle.answer.status = bits >> 44 & 3 ? Status::ok : Status::singular;
        cycle.suspected = static_cast<std::uint32_t>(bits >> 50 & 63);
        cycle.unused = static_cast<std::uint32_t>(bits >> 46 & 3);
        cycle.lost = (bits >> 56 & 15) == 0;
        cycle.disagree = (bits >> 57 & 15) == 0;
        cycle.known = (bits >> 58 & 15) != 0;
        cycle.counter.given = (bits >> 45 & 7) != 0;
        cycle.request.stop = (bits >> 59 & 15) == 0;
      }
      scene.step(cycle);
      ++in[static_cast<std::size_t>(scene.shell.machine.state)];
      follows += scene.shell.follows;
      for (int i = 0; i < n; ++i) CHECK(std::isfinite(scene.shell.torque[i]));
    }
    for (const long times : in) CHECK(times > 20);
    CHECK(follows > count / 100);
  });
}

TEST("after a requested stop a violation is the cause; frames at half the rate hide no overspeed") {
  for_some([](const Mechanism& mechanism, auto mobility) {
    Guarded<mobility()> scene(mechanism);
    scene.to_running();
    Guarded<mobility()> halved = scene;
    scene.press(&SafetyRequests::stop);
    scene.run_for(scene.rest());
    CHECK(scene.shell.cause == StopCause::requested);
    SafetyCycle cycle = scene.healthy();
    cycle.lost = true;
    scene.step(cycle);
    CHECK(scene.shell.machine.state == SafetyState::fault);
    CHECK(scene.shell.cause == StopCause::suspected_motor);

    halved.limits.deviation.fill(1e3);  // the speed alone
    const double per_cycle = halved.limits.speed[0] * halved.limits.period;
    SafetyCycle last = halved.healthy();
    halved.step(last);
    const auto half = [&](double speed) {
      return [&, speed](SafetyCycle& now, int k) {
        now.q[0] += speed * per_cycle * k;
        now.q_d[0] += 0.8 * std::min(speed, 1.0) * per_cycle * k;
        if (k % 2) {  // the frame of the last cycle, again
          now.q = last.q;
          now.counter = last.counter;
          now.time = last.time;
        }
        last = now;
      };
    };
    Guarded<mobility()> slow = halved;
    const SafetyCycle start = last;
    CHECK(slow.until_stop(30, half(0)) == -1);
    last = start;
    const int within = halved.until_stop(20, half(1.5));
    CHECK(within > 0 && within <= 10);
    CHECK(halved.shell.cause == StopCause::overspeed);
  });
}
