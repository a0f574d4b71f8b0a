// Time and instructions of each operation of the core, on the same inputs.
//
//   benchmark_core             median and fastest time of a call
//   benchmark_core --count     for instructions.py: callgrind counts each call by itself
//
// Inputs are the tests' H4, 6-UPS and ankle at a thousand random poses, which defeats branch
// prediction; for counts also hostile inputs, which no robot should meet. All are seeded: a count
// is the same on every run, whatever else the machine does; a time is not.
#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#else  // built all the same where nothing can be counted
#define CALLGRIND_ZERO_STATS
#define CALLGRIND_DUMP_STATS_AT(name) static_cast<void>(name)
#endif

#include <chrono>
#include <cstring>
#include <list>
#include <string>

#include "../tests/cpp/at_work.hpp"
#include "../tests/cpp/rotational.hpp"
#include "control/command.hpp"
#include "control/limit_defaults.hpp"
#include "estimation/online_calibrator.hpp"
#include "safety/safety_guard.hpp"
#include "simulation/plant.hpp"

using namespace truepose;

namespace {

constexpr Mobility kH4 = Mobility::schoenflies;
constexpr int kPoses = 1000, kRepeats = 51, kCounted = 300, kHostile = 420;

bool counting = false;
struct Row {
  std::string name;
  double median, fastest;  ///< seconds per call
};
std::vector<Row> rows;

/// Calls by reference, so that the compiler leaves out no work.
template <class F>
[[gnu::noinline]] Status once(F& call, int i) {
  return call(i);
}

template <class F>
void count(const std::string& name, bool usual, int calls, F& call) {
  const std::string trigger = name + (usual ? "" : "!");
  for (int i = 0; i < calls; ++i) {
    CALLGRIND_ZERO_STATS;
    const Status status = once(call, i);
    CALLGRIND_DUMP_STATS_AT(trigger.c_str());
    if (usual && status > Status::ok)
      std::printf("%s: no answer: %s\n", name.c_str(), describe(status));
  }
}

/// Times or counts call(i) of usual inputs i; each round begins with i = 0.
template <class F>
void usual(const std::string& name, F&& call) {
  if (counting) return count(name, true, kCounted, call);
  std::vector<double> seconds;
  for (int repeat = -1; repeat < kRepeats; ++repeat) {  // the first one warms up
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < kPoses; ++i) static_cast<void>(once(call, i));
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    if (repeat >= 0) seconds.push_back(taken.count() / kPoses);
  }
  std::sort(seconds.begin(), seconds.end());
  rows.push_back({name, seconds[kRepeats / 2], seconds.front()});
}

/// Counts call(k) of hostile inputs k, of which only the worst is asked for.
template <class F>
void hostile(const std::string& name, F&& call) {
  if (counting) count(name, false, kHostile, call);
}

/// Setpoints, readings and guesses of a robot, by cycle.
struct Inputs {
  std::vector<Setpoint> setpoint;
  std::vector<Extended> q_e;
  std::vector<Coordinates> guess;
};

/// Random poses: readings a little off the setpoint, guesses 1 mm and 1 mrad away (ankle: 10 mrad).
Inputs anywhere(const mechanisms::Mechanism& mechanism) {
  const Mobility K = mechanism.robot.mobility;
  Inputs in;
  check::Random random(1);
  for (int i = 0; i < kPoses; ++i) {
    Setpoint at;
    Joint q;
    Extended q_e;
    do at.x = mechanisms::random_pose(mechanism, random);
    while (!ikm(Level::ideal, mechanism.robot, at.x,
                q));  // an ankle's cranks cannot follow to every corner
    const Pose pose = to_pose(K, at.x);
    in.guess.push_back(
        to_coordinates(K, mechanisms::nearby(K, pose, random, is_rotational(K) ? 1e-2 : 1e-3)));
    at.rate = mechanisms::random_joint(random, 0.5);
    at.acceleration = mechanisms::random_joint(random, 5);
    if (!extended(Level::ideal, mechanism.robot, mechanisms::nearby(K, pose, random, 1e-4), q_e))
      std::printf("pose %d is out of reach\n", i);
    in.setpoint.push_back(at);
    in.q_e.push_back(q_e);
  }
  return in;
}

/// A path about home at 1 kHz, up to 0.4 m/s, on which what is cached lasts; readings 0.1 mm off
/// it, or in counts of the encoders.
Inputs path(const Robot& robot, double off, double step) {
  Inputs in;
  for (int k = 0; k < kPoses; ++k) {
    Setpoint at;
    for (int i = 0; i < 4; ++i) {
      const double omega = 3 + i, phase = omega * 1e-3 * k;
      at.x[i] = robot.home[i] + 0.03 * std::sin(phase);
      at.rate[i] = 0.03 * omega * std::cos(phase);
      at.acceleration[i] = -0.03 * omega * omega * std::sin(phase);
    }
    Pose pose = to_pose(kH4, at.x);
    pose.D += Vec3(off, -off, off);
    Extended q_e{};
    Parasitic rest;
    if (!extended(level_of(robot), robot, pose, q_e, &rest))
      std::printf("the path is out of reach\n");
    for (int c = 0; c < 5 && step > 0; ++c) q_e[c] = quantized(q_e[c], step);
    in.setpoint.push_back(at);
    in.q_e.push_back(q_e);
  }
  return in;
}

/// What a controller may be handed: setpoints and readings that fit neither the robot nor each
/// other.
Inputs never(const mechanisms::Mechanism& mechanism) {
  Inputs in;
  const Robot& robot = mechanism.robot;
  check::Random random(2);
  const auto any = [&](double size) { return mechanisms::random_joint(random, size); };
  const auto pose = [&](int kind) {
    Coordinates x = random_pose(mechanism, random);
    if (kind == 1) x = any(0.6);
    if (kind == 2 || kind == 3) {  // as far as the chains reach, or the motors hold the platform
      Coordinates inside = robot.home, out = robot.home;
      const Coordinates way = any(kind == 2 ? 1 : 0.05);
      for (int i = 0; i < 4; ++i) out[i] += way[i];
      if (kind == 3) out[3] += random() < 0 ? -2.5 : 2.5;
      for (int k = 0; k < 45; ++k) {
        for (int i = 0; i < 4; ++i) x[i] = 0.5 * (inside[i] + out[i]);
        Joint q;
        (command(Level::ideal, robot, x, q) ? inside : out) = x;
      }
    }
    return x;
  };
  const double odd[]{NAN, INFINITY, -INFINITY, 1e300, -1e6};
  for (int k = 0; k < kHostile; ++k) {
    Setpoint at{pose(k % 4)};
    Extended read{};
    if (!extended(Level::ideal, robot, to_pose(kH4, k % 3 == 0 ? at.x : pose(k / 4 % 4)), read))
      for (double& value : read) value = 4 * random();
    if (k % 7 == 1) read[k % 5] += std::pow(10, -3 + 3.5 * std::fabs(random()));
    if (k % 7 == 2) read = Extended{3 * random(), 3 * random(), 3 * random(), 3 * random(), 0.4};
    if (k % 7 == 3) read[k % 4] += 6.283185307179586 * (k % 9 - 4);
    if (k % 28 == 4) read[k % 5] = odd[k % 5];
    if (k % 28 == 11) at.x[k % 4] = odd[k % 5];
    if (k % 28 == 18) at.rate[k % 4] = odd[k % 5];
    in.setpoint.push_back(at);
    in.q_e.push_back(read);
    in.guess.push_back(k % 2 == 0 ? robot.home : pose(k / 2 % 4));
  }
  return in;
}

/// Kinematics from coordinates; names are those of the H4, the 6-UPS or the ankle.
void kinematics(const std::array<const char*, 5>& name, const Robot& robot, const Inputs& in,
                const Inputs* odd = nullptr) {
  const auto each = [&](const char* named, auto call) {
    usual(named, [&](int i) { return call(in, i); });
    if (odd) hostile(named, [&](int k) { return call(*odd, k); });
  };
  const Mobility K = robot.mobility;
  Joint q;
  JointMatrix J;
  Coordinates x;
  each(name[0], [&](const Inputs& of, int i) {
    return ikm(Level::ideal, robot, of.setpoint[i].x, q).status;
  });
  each(name[1], [&](const Inputs& of, int i) {
    return jacobian(Level::ideal, robot, of.setpoint[i].x, J).status;
  });
  each(name[2], [&](const Inputs& of, int i) {
    Closure closure;
    Jacobians jacobians;
    const Outcome closed = ikm(robot, to_pose(K, of.setpoint[i].x), closure);
    return closed ? jacobian(closure, jacobians).status : closed.status;
  });
  each(name[3], [&](const Inputs& of, int i) {
    x = of.guess[i];
    return fkm(Level::ideal, robot, motors_of(robot, of.q_e[i]), x).status;
  });
  each(name[4], [&](const Inputs& of, int i) {
    x = is_rotational(K) ? Coordinates{} : robot.home;
    return fkm(Level::ideal, robot, motors_of(robot, of.q_e[i]), x).status;
  });
}

/// A law on usual inputs, then on hostile ones, each a cycle after a usual one.
void cycles(const char* name, const Robot& robot, const ControlSettings& settings,
            const Weighing& weighing, const Inputs& in, const Inputs& odd) {
  ControlState state;
  usual(name, [&](int i) {
    return control(robot, settings, in.setpoint[i], in.q_e[i], state, weighing).status;
  });
  hostile(name, [&](int k) {
    ControlState after = state;
    return control(robot, settings, odd.setpoint[k], odd.q_e[k], after, weighing).status;
  });
}

/// A robot at work, and its cycles.
struct Scene {
  Scene(const mechanisms::Mechanism& mechanism, Level level, int sensors, int usual, int hostile)
      : of(mechanism, level, sensors), motion(of.motion(usual)), trouble(of.trouble(hostile)) {}
  mechanisms::AtWork of;
  std::vector<mechanisms::AtWork::Cycle> motion, trouble;
};

/// Whole cycles of robots at work under a law, with or without the fault monitor: usual ones, then
/// each of trouble after a usual one, twice: what does not end within a cycle goes on.
void cycles(const std::string& name, std::list<Scene>& scenes, Law law, bool caches,
            bool monitored) {
  for (Scene& scene : scenes) {
    const Robot& robot = scene.of.robot;
    Weighing weighing = scene.of.prior.weighing();
    ControlSettings settings;
    settings.law = law;
    FaultTolerantSettings monitoring;
    monitoring.monitor.fastest.fill(500);
    monitoring.monitor.moved.fill(2e-3);
    prepare(monitoring.monitor);
    if (!place_poles(robot, robot.home, 150, 1, settings)) std::printf("home is singular\n");
    struct Controller {
      ControlState state;
      FaultTolerantState faults;
      CachedGain kept;
    } controller;
    const auto cycle = [&](Controller& by, const mechanisms::AtWork::Cycle& at) {
      weighing.kept = caches ? &by.kept : nullptr;
      return monitored ? control_fault_tolerant(robot, settings, monitoring, at.setpoint, at.q_e,
                                                by.state, weighing, by.faults)
                             .status
                       : control(robot, settings, at.setpoint, at.q_e, by.state, weighing).status;
    };
    const auto moves = [&](int i) { return cycle(controller, scene.motion[i]); };
    if (!counting) {
      usual(name, moves);
      continue;
    }
    count(name, true, static_cast<int>(scene.motion.size()), moves);
    for (const auto& wrong : scene.trouble) {
      Controller after = controller;
      const auto twice = [&](int) { return cycle(after, wrong); };
      count(name, false, 2, twice);
    }
  }
}

/// Every law at both levels, with and without the fault monitor.
void every_law(const std::string& group, const std::vector<mechanisms::Mechanism>& robots,
               const std::vector<int>& sensors, int usual, int hostile) {
  for (const Level level : {Level::ideal, Level::full}) {
    std::list<Scene> scenes;
    for (const mechanisms::Mechanism& robot : robots)
      for (const int r : sensors) scenes.emplace_back(robot, level, r, usual, hostile);
    for (const LawProperties& law : kLawTable)
      for (const bool caches : {false, true})
        for (const bool monitored : {false, true})
          if (law.weighs || !caches)
            cycles(group + (level == Level::full ? " full " : " ideal ") + law.name +
                       (caches ? ", cached" : "") + (monitored ? ", monitored" : ""),
                   scenes, law.law, caches, monitored);
  }
}

/// Fault monitor and safety shell where nothing is wrong: alone, then around the TEJ law.
void monitors(Robot robot, const ControlSettings& settings, const Weighing& weighing,
              const Inputs& on_path, const Inputs& odd) {
  FaultTolerantSettings monitoring;
  monitoring.monitor.fastest.fill(500);
  monitoring.monitor.moved.fill(2e-3);
  prepare(monitoring.monitor);
  FaultMonitor seen;
  usual("H4 fault monitor", [&](int i) {
    if (i == 0) seen = {};
    Extended believed;
    const Extended& q_e = on_path.q_e[i];
    return monitor_faults(robot, monitoring.monitor, weighing, motors_of(robot, q_e), q_e, seen,
                          believed)
        .status;
  });
  ControlState state;
  FaultTolerantState fault_state;
  const FaultTolerantState unmonitored;
  usual("H4 fault-tolerant TEJ", [&](int i) {
    if (i == 0) fault_state = unmonitored;
    return control_fault_tolerant(robot, settings, monitoring, on_path.setpoint[i], on_path.q_e[i],
                                  state, weighing, fault_state)
        .status;
  });

  for (int i = 0; i < 4; ++i) robot.chain[i].torque_limit = 1000 * settings.kp[i] / 150 / 150;
  SafetyLimits limits;
  if (!default_limits(robot, settings, limits)) std::printf("no limits\n");
  struct Shelled {
    ControlState state;
    FaultTolerantState fault_state;
    SafetyGuard guard;
    SafetyShell alone;
    SafetyCycle cycle;
  } begun, now;
  begun.guard.limits = limits;
  const auto cycle = [&](Shelled& of, int k) {
    of.guard.next.counter = {true, static_cast<std::uint64_t>(100 + k)};
    of.guard.next.request = {k == 40, false, k == 20};
    const int i = std::max(k - 80, 0);
    const Monitored monitored{&monitoring, &of.fault_state};
    return control_guarded(robot, settings, on_path.setpoint[i], on_path.q_e[i], of.state, of.guard,
                           weighing, monitored);
  };
  const auto completed = [&](Shelled& of, int k) {
    static_cast<void>(cycle(of, k));
    of.cycle = of.guard.next;
  };
  const auto guarded = [&] {
    guard(robot, limits, now.cycle, now.alone);
    return now.alone.follows ? Status::ok : Status::unfinished;
  };
  for (int k = 0; k < 80; ++k) {  // acknowledged, started, brakes open
    completed(begun, k);
    guard(robot, limits, begun.cycle, begun.alone);
  }
  usual("H4 safe TEJ", [&](int i) {
    if (i == 0) now = begun;
    return cycle(now, 80 + i).status;
  });
  std::vector<SafetyCycle> seen_cycles;
  now = begun;
  for (int i = 0; i < kPoses; ++i) {
    completed(now, 80 + i);
    seen_cycles.push_back(now.cycle);
  }
  usual("H4 safety shell", [&](int i) {
    if (i == 0) now.alone = begun.alone;
    now.cycle = seen_cycles[i];
    return guarded();
  });
  const Shelled last = now;
  hostile("H4 safety shell", [&](int k) {
    now.alone = last.alone;
    now.cycle = last.cycle;
    now.cycle.counter.value += 1;
    now.cycle.q = motors_of(robot, odd.q_e[k]);
    return guarded();
  });
}

ControlSettings settings_for(const Robot& robot, Law law, FeedForward feed_forward,
                             Gains gains = {}) {
  ControlSettings settings;
  settings.law = law;
  settings.feed_forward = feed_forward;
  settings.gains = gains;
  if (!place_poles(robot, robot.home, 150, 1, settings)) std::printf("home is singular\n");
  return settings;
}

}  // namespace

int main(int argc, char** argv) {
  counting = argc > 1 && std::strcmp(argv[1], "--count") == 0;
  const mechanisms::Mechanism mechanism = mechanisms::h4();
  const Robot& h4 = mechanism.robot;
  const Inputs in = anywhere(mechanism), odd = never(mechanism);
  kinematics({"H4 IKM", "H4 J(x)", "H4 IKM + J", "H4 FKM from 1 mm, 1 mrad", "H4 FKM from home"},
             h4, in, &odd);
  const mechanisms::Mechanism ups = mechanisms::hexapod("6-UPS", Actuator::telescopic);
  kinematics({"6-UPS IKM", "6-UPS J(x)", "6-UPS IKM + J", "6-UPS FKM from 1 mm, 1 mrad",
              "6-UPS FKM from home"},
             ups.robot, anywhere(ups));
  const mechanisms::Mechanism ankle = pivots_tested::g1_ankle();
  kinematics({"ankle IKM", "ankle J(x)", "ankle IKM + J", "ankle FKM from 10 mrad",
              "ankle FKM from neutral"},
             ankle.robot, anywhere(ankle));

  const auto each = [&](const char* name, auto call) {
    usual(name, [&](int i) { return call(in, i); });
    hostile(name, [&](int k) { return call(odd, k); });
  };
  each("H4 FKM from home, 12 steps", [&](const Inputs& of, int i) {
    Coordinates x = h4.home;
    return fkm(Level::ideal, h4, motors_of(h4, of.q_e[i]), x, 12).status;
  });
  each("H4 FKM, closed, θ known", [&](const Inputs& of, int i) {
    Vec3 D = Vec3::Zero();
    return fkm_closed(h4, motors_of(h4, of.q_e[i]), to_pose(kH4, of.setpoint[i].x).R,
                      Vec3(0, 0, -0.4), D)
        .status;
  });
  ExtendedColumns M;
  ExtendedRows M_plus;
  each("H4 TEJ",
       [&](const Inputs& of, int i) { return tej(h4, of.setpoint[i].x, M, M_plus).status; });
  usual("H4 forward dynamics", [&](int i) {
    Coordinates acceleration;
    return forward_dynamics(h4, to_pose(kH4, in.setpoint[i].x), in.setpoint[i].rate, Joint{},
                            acceleration)
        .status;
  });

  mechanisms::Prior prior(h4);
  each("H4 estimate", [&](const Inputs& of, int i) {
    Pose pose = to_pose(kH4, &of == &odd ? of.guess[i] : of.setpoint[i].x);
    return estimate(Level::ideal, h4, prior.known(), of.q_e[i], pose, prior.weighing().work)
        .outcome.status;
  });
  {
    mechanisms::Prior taught(h4);
    OnlineCalibrator learner;
    usual("H4 online calibration", [&](int i) {
      if (i == 0) learner = taught.learner(h4);
      return calibrate_online(learner, in.q_e[i]).status;
    });
    for (int k = 0; k < kHostile && counting; ++k) {  // each a row after a usual one
      learner = taught.learner(h4);
      static_cast<void>(calibrate_online(learner, in.q_e[k % kCounted]));
      const auto call = [&](int) { return calibrate_online(learner, odd.q_e[k]).status; };
      count("H4 online calibration", false, 1, call);
    }
  }

  const ControlSettings tej = settings_for(h4, Law::tej, FeedForward::none),
                        weighted = settings_for(h4, Law::weighted, FeedForward::none),
                        estimated = settings_for(h4, Law::estimated, FeedForward::none);
  cycles("H4 joint", h4, settings_for(h4, Law::joint, FeedForward::none), {}, in, odd);
  cycles("H4 TEJ law", h4, tej, {}, in, odd);
  cycles("H4 cartesian", h4, settings_for(h4, Law::cartesian, FeedForward::none), {}, in, odd);
  cycles("H4 TEJ law, feed-forward", h4, settings_for(h4, Law::tej, FeedForward::full), {}, in,
         odd);
  cycles("H4 TEJ law, feed-forward, inertia", h4,
         settings_for(h4, Law::tej, FeedForward::full, Gains::inertia), {}, in, odd);
  cycles("H4 weighted", h4, weighted, prior.weighing(), in, odd);
  cycles("H4 estimated", h4, estimated, prior.weighing(), in, odd);

  every_law("H4 at work,", {mechanism}, {1}, counting ? kCounted : kPoses, 70);
  if (counting) every_law("robots at work,", mechanisms::every_rod(), {1, 6}, 15, 14);
  monitors(h4, tej, prior.weighing(), path(h4, 0, 3e-5), odd);

  if (counting) return 0;
  std::puts("| one call of | median (µs) | fastest (µs) |\n|---|---:|---:|");
  for (const Row& row : rows)
    std::printf("| %s | %.3f | %.3f |\n", row.name.c_str(), 1e6 * row.median, 1e6 * row.fastest);
  return 0;
}
