// Instruction count of each call. The functions f_… that instructions.py counts, call
// by call: at poses of the box, and on inputs that no robot should meet. A count is the same on
// every run, whatever else the machine does; a time is not.
#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#else  // built all the same where nothing can be counted
#define CALLGRIND_ZERO_STATS
#define CALLGRIND_DUMP_STATS_AT(name) static_cast<void>(name)
#endif

#include "bench.hpp"
#include "inputs.hpp"
#include "truepose/control/command.hpp"
#include "truepose/control/safe_control.hpp"
#include "truepose/estimation/online_calibrator.hpp"
#include "truepose/offline/plant.hpp"
#include "truepose/offline/safety_defaults.hpp"

using namespace inputs;

namespace {
constexpr Mobility kH4 = Mobility::schoenflies;
}

#define COUNTED extern "C" __attribute__((noinline))

COUNTED Status f_ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm(robot, x, q).status;
}
COUNTED Status f_jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian(robot, x, J).status;
}
COUNTED Status f_fkm_near(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}
COUNTED Status f_fkm_home(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}
COUNTED Status f_fkm_home_12(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x, 12).status;
}
COUNTED Status f_fkm_closed(const Robot& robot, const Joint& q, const Mat3& R, Vec3& D) {
  return fkm_closed<kH4>(robot, q, R, Vec3(0, 0, -0.4), D).status;
}
COUNTED Status f_tej(const Robot& robot, const Coordinates& x, ExtendedColumns& M,
                     ExtendedRows& M_plus) {
  return tej(robot, x, M, M_plus).status;
}
COUNTED Status f_control_joint(const Robot& robot, const ControlSettings& settings,
                               const Setpoint& setpoint, const Extended& q_e, ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_tej(const Robot& robot, const ControlSettings& settings,
                             const Setpoint& setpoint, const Extended& q_e, ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_cartesian(const Robot& robot, const ControlSettings& settings,
                                   const Setpoint& setpoint, const Extended& q_e,
                                   ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_feed_forward(const Robot& robot, const ControlSettings& settings,
                                      const Setpoint& setpoint, const Extended& q_e,
                                      ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_inertia(const Robot& robot, const ControlSettings& settings,
                                 const Setpoint& setpoint, const Extended& q_e,
                                 ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_weighted(const Robot& robot, const ControlSettings& settings,
                                  const Setpoint& setpoint, const Extended& q_e,
                                  ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_weighted_kept(const Robot& robot, const ControlSettings& settings,
                                       const Setpoint& setpoint, const Extended& q_e,
                                       ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_weighted_full(const Robot& robot, const ControlSettings& settings,
                                       const Setpoint& setpoint, const Extended& q_e,
                                       ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_weighted_full_kept(const Robot& robot, const ControlSettings& settings,
                                            const Setpoint& setpoint, const Extended& q_e,
                                            ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_estimated(const Robot& robot, const ControlSettings& settings,
                                   const Setpoint& setpoint, const Extended& q_e,
                                   ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_estimated_kept(const Robot& robot, const ControlSettings& settings,
                                        const Setpoint& setpoint, const Extended& q_e,
                                        ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_estimated_full(const Robot& robot, const ControlSettings& settings,
                                        const Setpoint& setpoint, const Extended& q_e,
                                        ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_estimated_full_kept(const Robot& robot, const ControlSettings& settings,
                                             const Setpoint& setpoint, const Extended& q_e,
                                             ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_estimate(const Robot& robot, const Knowledge& known, const Extended& q_e,
                          Pose& pose, double* work) {
  return estimate<kH4>(robot, known, q_e, pose, work).outcome.status;
}
COUNTED Status f_learn(OnlineCalibrator& learner, const Extended& q_e) {
  return calibrate_online<kH4>(learner, q_e).status;
}
COUNTED Status f_monitor(const Robot& robot, const FaultMonitorSettings& settings,
                         const Weighing& weighing, const Joint& desired, const Extended& q_e,
                         FaultMonitor& seen, Extended& believed) {
  return monitor_faults<kH4>(robot, settings, weighing, desired, q_e, seen, believed).status;
}
COUNTED Status f_fault_tolerant_tej(const Robot& robot, const ControlSettings& settings,
                                    const FaultTolerantSettings& fault_settings,
                                    const Setpoint& setpoint, const Extended& q_e,
                                    ControlState& state, const Weighing& weighing,
                                    FaultTolerantState& fault_state) {
  return control_fault_tolerant<kH4>(robot, settings, fault_settings, setpoint, q_e, state,
                                     weighing, fault_state)
      .status;
}
COUNTED Status f_guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
                       SafetyShell& shell) {
  guard<kH4>(robot, limits, cycle, shell);
  return shell.follows ? Status::ok : Status::unfinished;
}
COUNTED Status f_safe_tej(const Robot& robot, const ControlSettings& settings,
                          const SafetyLimits& limits, const Setpoint& setpoint, const Extended& q_e,
                          ControlState& state, SafetyShell& shell, SafetyCycle& cycle,
                          const Weighing& weighing, const Monitored& monitored) {
  return control_safely<kH4>(robot, settings, limits, setpoint, q_e, state, shell, cycle, weighing,
                             monitored)
      .status;
}
COUNTED Status f_forward_dynamics(const Robot& robot, const Pose& pose, const Coordinates& rate,
                                  Coordinates& acceleration) {
  return forward_dynamics<kH4>(robot, pose, rate, Joint{}, acceleration).status;
}
COUNTED Status f_ups_ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm(robot, x, q).status;
}
COUNTED Status f_ups_jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian(robot, x, J).status;
}
COUNTED Status f_ups_fkm_near(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}
COUNTED Status f_ankle_ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm(robot, x, q).status;
}
COUNTED Status f_ankle_jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian(robot, x, J).status;
}
COUNTED Status f_ankle_fkm_near(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}
COUNTED Status f_ankle_fkm_neutral(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}

namespace {

constexpr int kCounted = 300;  ///< calls of each function on usual inputs

/// Counts a call of f. @param usual  else among those of which only the worst is asked for
template <class F>
void count(const char* name, bool usual, F&& call) {
  static char trigger[64];
  std::snprintf(trigger, sizeof trigger, "%s%s", name, usual ? "" : "!");
  CALLGRIND_ZERO_STATS;
  const Status status = call();
  CALLGRIND_DUMP_STATS_AT(trigger);
  if (usual && status > Status::ok) std::printf("%s: no answer: %s\n", name, describe(status));
}
#define COUNT(usual, function, ...) count(#function, usual, [&] { return function(__VA_ARGS__); })

/// A path about home at 1 kHz, up to 0.4 m/s: what is kept from cycle to cycle lasts on it.
Setpoint along(const Robot& robot, double time) {
  Setpoint setpoint;
  for (int i = 0; i < 4; ++i) {
    const double omega = 3 + i, phase = omega * time;
    setpoint.x[i] = robot.home[i] + 0.03 * std::sin(phase);
    setpoint.rate[i] = 0.03 * omega * std::cos(phase);
    setpoint.acceleration[i] = -0.03 * omega * omega * std::sin(phase);
  }
  return setpoint;
}

/// What a controller may be handed: setpoints and readings that fit neither the robot nor each
/// other.
struct Hostile {
  std::vector<Setpoint> setpoint;
  std::vector<Extended> q_e;
  std::vector<Coordinates> guess;

  explicit Hostile(const Robot& robot) {
    const mechanisms::Mechanism mechanism = mechanisms::h4();
    check::Random random(2);
    const auto any = [&](double size) { return mechanisms::random_joint(random, size); };
    const auto pose = [&](int kind) {
      Coordinates x = random_pose(mechanism, random);
      if (kind == 1) x = any(0.6);
      if (kind == 2 || kind == 3) {  // as far as the chains reach, or the motors hold the nacelle
        Coordinates in = robot.home, out = robot.home;
        const Coordinates way = any(kind == 2 ? 1 : 0.05);
        for (int i = 0; i < 4; ++i) out[i] += way[i];
        if (kind == 3) out[3] += random() < 0 ? -2.5 : 2.5;
        for (int k = 0; k < 45; ++k) {
          for (int i = 0; i < 4; ++i) x[i] = 0.5 * (in[i] + out[i]);
          Joint q;
          (command(robot, x, q) ? in : out) = x;
        }
      }
      return x;
    };
    const double odd[]{NAN, INFINITY, -INFINITY, 1e300, -1e6};
    for (int k = 0; k < 420; ++k) {
      Setpoint at{pose(k % 4)};
      Extended read{};
      if (!extended<kH4>(robot, to_pose<kH4>(k % 3 == 0 ? at.x : pose(k / 4 % 4)), read))
        for (double& value : read) value = 4 * random();
      if (k % 7 == 1) read[k % 5] += std::pow(10, -3 + 3.5 * std::fabs(random()));
      if (k % 7 == 2) read = Extended{3 * random(), 3 * random(), 3 * random(), 3 * random(), 0.4};
      if (k % 7 == 3) read[k % 4] += 6.283185307179586 * (k % 9 - 4);
      if (k % 28 == 4) read[k % 5] = odd[k % 5];
      if (k % 28 == 11) at.x[k % 4] = odd[k % 5];
      if (k % 28 == 18) at.rate[k % 4] = odd[k % 5];
      setpoint.push_back(at);
      q_e.push_back(read);
      guess.push_back(k % 2 == 0 ? robot.home : pose(k / 2 % 4));
    }
  }
};

/// A law on usual inputs, then on hostile ones, each a cycle after a usual one.
template <class Call>
void count_law(const Inputs<kH4>& h4, const Hostile& hostile, Call&& call) {
  ControlState state;
  for (int i = 0; i < kCounted; ++i) call(true, h4.setpoint[i], h4.q_e[i], state);
  for (std::size_t k = 0; k < hostile.q_e.size(); ++k) {
    ControlState after = state;
    call(false, hostile.setpoint[k], hostile.q_e[k], after);
  }
}

/// A law whose weights are kept, on the path, then on hostile inputs.
template <class Call>
void count_kept(const Robot& robot, const Hostile& hostile, Weighing weighing, Call&& call) {
  CachedGain kept;
  weighing.kept = &kept;
  ControlState state;
  Parasitic rest;
  for (int i = 0; i < kCounted; ++i) {
    const Setpoint setpoint = along(robot, 1e-3 * i);
    Pose pose = to_pose<kH4>(setpoint.x);
    pose.D += Vec3(1e-4, -1e-4, 1e-4);
    Extended q_e;
    if (!exact_readings<kH4>(robot, pose, q_e, rest)) std::printf("the path is out of reach\n");
    call(true, setpoint, q_e, state, weighing);
  }
  for (std::size_t k = 0; k < hostile.q_e.size(); ++k) {
    ControlState after = state;
    CachedGain then = kept;
    weighing.kept = &then;
    call(false, hostile.setpoint[k], hostile.q_e[k], after, weighing);
  }
}

FaultTolerantSettings monitoring() {
  FaultTolerantSettings settings;
  settings.monitor.fastest.fill(500);
  settings.monitor.moved.fill(2e-3);
  settings.momentum.period = 4e-3;  // as FaultMonitor's: every fourth cycle
  settings.momentum.sigma.fill(50);
  prepare(settings.monitor);
  return settings;
}

/// Readings in counts at a setpoint.
Extended counts_at(const Robot& robot, const Setpoint& setpoint) {
  Extended q_e{};
  if (!extended<kH4>(robot, to_pose<kH4>(setpoint.x), q_e)) std::printf("out of reach\n");
  for (int c = 0; c < 5; ++c) q_e[c] = quantized(q_e[c], 3e-5);
  return q_e;
}

/// What a monitor costs where nothing is wrong: on the path, in counts, the rarer cycles with a
/// look at the geometry among them.
void count_monitor(const Robot& robot, const ControlSettings& settings, const Weighing& weighing) {
  const FaultTolerantSettings fault_settings = monitoring();
  FaultMonitor seen;
  FaultTolerantState fault_state;
  ControlState state;
  for (int k = 0; k < kCounted; ++k) {
    const Setpoint setpoint = along(robot, settings.period * k);
    const Extended q_e = counts_at(robot, setpoint);
    Extended believed;
    const Joint desired = motors_of<kH4>(q_e);
    COUNT(true, f_monitor, robot, fault_settings.monitor, weighing, desired, q_e, seen, believed);
    COUNT(true, f_fault_tolerant_tej, robot, settings, fault_settings, setpoint, q_e, state,
          weighing, fault_state);
  }
}

/// The safety shell on the same path in `running`: alone, and around the monitored TEJ law. Then
/// hostile readings, each a cycle after a usual one.
void count_safety(Robot robot, const Hostile& hostile, ControlSettings settings,
                  const Weighing& weighing) {
  for (int i = 0; i < 4; ++i) robot.chain[i].torque_limit = 1000 * settings.kp[i] / 150 / 150;
  SafetyLimits limits;
  if (!default_limits(robot, settings, limits)) std::printf("no limits\n");
  const FaultTolerantSettings fault_settings = monitoring();
  FaultTolerantState fault_state;
  ControlState state;
  SafetyShell shell, alone;
  SafetyCycle cycle;
  const Monitored monitored{&fault_settings, &fault_state};
  constexpr int kBegin = 80;  // acknowledged, started, brakes open
  const auto marked = [&](int k) {
    SafetyCycle marks;
    marks.counter = {true, static_cast<std::uint64_t>(100 + k)};
    marks.request = {k == 40, false, k == 20};
    return marks;
  };
  for (int k = -kBegin; k < kCounted; ++k) {
    const Setpoint setpoint = along(robot, settings.period * std::max(k, 0));
    const Extended q_e = counts_at(robot, setpoint);
    cycle = marked(k + kBegin);
    if (k < 0) {
      static_cast<void>(f_safe_tej(robot, settings, limits, setpoint, q_e, state, shell, cycle,
                                   weighing, monitored));
      guard<kH4>(robot, limits, cycle, alone);
      continue;
    }
    COUNT(true, f_safe_tej, robot, settings, limits, setpoint, q_e, state, shell, cycle, weighing,
          monitored);
    COUNT(true, f_guard, robot, limits, cycle, alone);
  }
  for (const Extended& q_e : hostile.q_e) {
    SafetyCycle odd = cycle;
    odd.counter.value += 1;
    odd.q = motors_of<kH4>(q_e);
    SafetyShell after = alone;
    COUNT(false, f_guard, robot, limits, odd, after);
  }
}

void count_kinematics(const Inputs<kH4>& h4, const Hostile& hostile) {
  Joint q{};
  JointMatrix J;
  ExtendedColumns M;
  ExtendedRows M_plus;
  Vec3 D = Vec3::Zero();
  for (int i = 0; i < kCounted; ++i) {
    Coordinates near = h4.near[i], home = h4.robot.home, again = home, acceleration{};
    COUNT(true, f_ikm, h4.robot, h4.x[i], q);
    COUNT(true, f_jacobian, h4.robot, h4.x[i], J);
    COUNT(true, f_fkm_near, h4.robot, h4.q[i], near);
    COUNT(true, f_fkm_home, h4.robot, h4.q[i], home);
    COUNT(true, f_fkm_home_12, h4.robot, h4.q[i], again);
    COUNT(true, f_fkm_closed, h4.robot, h4.q[i], h4.R[i], D);
    COUNT(true, f_tej, h4.robot, h4.x[i], M, M_plus);
    COUNT(true, f_forward_dynamics, h4.robot, to_pose<kH4>(h4.x[i]), h4.setpoint[i].rate,
          acceleration);
  }
  for (std::size_t k = 0; k < hostile.q_e.size(); ++k) {
    const Coordinates& x = hostile.setpoint[k].x;
    const Joint motors = motors_of<kH4>(hostile.q_e[k]);
    Coordinates near = hostile.guess[k], home = h4.robot.home, again = hostile.guess[k];
    COUNT(false, f_ikm, h4.robot, x, q);
    COUNT(false, f_jacobian, h4.robot, x, J);
    COUNT(false, f_fkm_near, h4.robot, motors, near);
    COUNT(false, f_fkm_home, h4.robot, motors, home);
    COUNT(false, f_fkm_home_12, h4.robot, motors, again);
    COUNT(false, f_fkm_closed, h4.robot, motors, to_pose<kH4>(x).R, D);
    COUNT(false, f_tej, h4.robot, x, M, M_plus);
  }
}

void count_ups() {
  const Inputs<Mobility::spatial> ups(mechanisms::hexapod("6-UPS", Actuator::telescopic));
  Joint q{};
  JointMatrix J;
  for (int i = 0; i < kCounted; ++i) {
    Coordinates near = ups.near[i];
    COUNT(true, f_ups_ikm, ups.robot, ups.x[i], q);
    COUNT(true, f_ups_jacobian, ups.robot, ups.x[i], J);
    COUNT(true, f_ups_fkm_near, ups.robot, ups.q[i], near);
  }
}

void count_ankle() {
  const Inputs<Mobility::rotational_2> ankle(pivots_tested::g1_ankle());
  Joint q{};
  JointMatrix J;
  for (int i = 0; i < kCounted; ++i) {
    Coordinates near = ankle.near[i], neutral{};
    COUNT(true, f_ankle_ikm, ankle.robot, ankle.x[i], q);
    COUNT(true, f_ankle_jacobian, ankle.robot, ankle.x[i], J);
    COUNT(true, f_ankle_fkm_near, ankle.robot, ankle.q[i], near);
    COUNT(true, f_ankle_fkm_neutral, ankle.robot, ankle.q[i], neutral);
  }
}

/// Estimates and lines of the learner; hostile lines each after a usual one.
void count_readings(const Inputs<kH4>& h4, const Hostile& hostile) {
  mechanisms::Prior prior(h4.robot), taught(h4.robot);
  OnlineCalibrator learner = taught.learner(h4.robot);
  for (int i = 0; i < kCounted; ++i) {
    Pose pose = to_pose<kH4>(h4.x[i]);
    COUNT(true, f_estimate, h4.robot, prior.known(), h4.q_e[i], pose, prior.weighing().work);
    COUNT(true, f_learn, learner, h4.q_e[i]);
  }
  for (std::size_t k = 0; k < hostile.q_e.size(); ++k) {
    Pose pose = to_pose<kH4>(hostile.guess[k]);
    COUNT(false, f_estimate, h4.robot, prior.known(), hostile.q_e[k], pose, prior.weighing().work);
    mechanisms::Prior once(h4.robot);
    OnlineCalibrator pupil = once.learner(h4.robot);
    if (!calibrate_online<kH4>(pupil, h4.q_e[k % kCounted]))
      std::printf("a usual line is not learnt\n");
    COUNT(false, f_learn, pupil, hostile.q_e[k]);
  }
}

}  // namespace

int main() {
  const Inputs<kH4> h4(mechanisms::h4());
  const Hostile hostile(h4.robot);
  const auto settings = [&](Law law) { return settings_for(h4.robot, law, FeedForward::none); };
  const ControlSettings joint = settings(Law::joint), tej = settings(Law::tej),
                        cartesian = settings(Law::cartesian), weighted = settings(Law::weighted),
                        estimated = settings(Law::estimated),
                        full = settings_for(h4.robot, Law::tej, FeedForward::full);
  ControlSettings inertia = full;
  inertia.gains = Gains::inertia;
  if (!place_poles(h4.robot, h4.robot.home, 150, 1, inertia)) std::printf("home is singular\n");
  mechanisms::Prior prior(h4.robot);
  Robot rods = h4.robot;  // understood rod by rod, its axes 0.1° off
  rods.level = Level::full;
  for (int i = 0; i < 4; ++i) {
    Chain& chain = rods.chain[i];
    chain.axis =
        exp_so3(mechanisms::degrees(i % 2 == 0 ? 0.1 : -0.1) * chain.zero()) * chain.axis();
  }
  if (!finish(rods) || !finish_full(rods)) std::printf("the rods do not close at home\n");

  count_kinematics(h4, hostile);
  count_ups();
  count_ankle();
  count_readings(h4, hostile);
#define COUNT_LAW(function, settings, ...)                                                        \
  count_law(h4, hostile,                                                                          \
            [&](bool usual, const Setpoint& setpoint, const Extended& q_e, ControlState& state) { \
              COUNT(usual, function, h4.robot, settings, setpoint, q_e,                           \
                    state __VA_OPT__(, ) __VA_ARGS__);                                            \
            })
  COUNT_LAW(f_control_joint, joint);
  COUNT_LAW(f_control_tej, tej);
  COUNT_LAW(f_control_cartesian, cartesian);
  COUNT_LAW(f_control_feed_forward, full);
  COUNT_LAW(f_control_inertia, inertia);
  COUNT_LAW(f_control_weighted, weighted, prior.weighing());
  COUNT_LAW(f_control_estimated, estimated, prior.weighing());
#define COUNT_KEPT(function, robot, settings, keeps)                                             \
  count_kept(robot, hostile, prior.weighing(),                                                   \
             [&](bool usual, const Setpoint& setpoint, const Extended& q_e, ControlState& state, \
                 Weighing weighing) {                                                            \
               if (!(keeps)) weighing.kept = nullptr;                                            \
               COUNT(usual, function, robot, settings, setpoint, q_e, state, weighing);          \
             })
  COUNT_KEPT(f_control_weighted_kept, h4.robot, weighted, true);
  COUNT_KEPT(f_control_estimated_kept, h4.robot, estimated, true);
  COUNT_KEPT(f_control_weighted_full, rods, weighted, false);
  COUNT_KEPT(f_control_weighted_full_kept, rods, weighted, true);
  COUNT_KEPT(f_control_estimated_full, rods, estimated, false);
  COUNT_KEPT(f_control_estimated_full_kept, rods, estimated, true);
  count_monitor(h4.robot, tej, prior.weighing());
  count_safety(h4.robot, hostile, tej, prior.weighing());
  return 0;
}
