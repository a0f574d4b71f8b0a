// The safety shell around a law: checks of each cycle, and torques and brakes that follow from
// them.
#include "control/safety_shell.hpp"

namespace truepose {
void DrivenWays::begin(int i, Real q_d) {
  from[i] = q_d;
  error[i] = pushed[i] = way[i] = 0;
  cycles[i] = 0;
}

Real DrivenWays::advance(const SafetyLimits& limits, int i, Real q_d, Real off, Real rests) {
  Real away = q_d - from[i];
  if (off != 0 && !(off * away >= away * away)) away = off * away > 0 ? off : 0;
  const Real last = error[i];
  error[i] = away - std::clamp(away, -rests, rests);
  pushed[i] += limits.period * limits.kp[i] * error[i] + limits.kd[i] * (error[i] - last);
  if (error[i] == 0) pushed[i] = 0;
  cycles[i] = error[i] == 0 ? 0 : std::min(cycles[i] + 1, kMostDriven);
  return way[i] += limits.period * pushed[i];
}

namespace {
using namespace safety_detail;

constexpr Real kOneCount = 1.0 / 3;  ///< that motion leaves unseen, over `still`
/// One motor stands still while its loop drives it: ways over `still` and over `tracking`, the
/// larger of which is too far.
constexpr Real kStuckStill = 7, kStuckTracking = 0.1;

/// Violations of one cycle, as bits, each with the motor that was first.
struct Found {
  std::uint32_t causes = 0;
  std::array<int, kCauses> part;
  void add(bool violated, StopCause cause, int motor = -1) {
    if (!violated) return;
    if (!(causes & bit_of(cause))) part[static_cast<std::size_t>(cause)] = motor;
    causes |= bit_of(cause);
  }
  StopCause first() const { return static_cast<StopCause>(std::countr_zero(causes | 1U << 31)); }
};

bool number(Real value) { return std::fabs(value) < 1e9; }

/// Adds or takes off a period of a time that a condition has held.
void hold_time(bool holds, Real period, Real& time) {
  time = std::max(time + (holds ? period : -period), Real{0});
}

/// The steps of one cycle of a robot with n motors and so many freedoms: frame, readings, law,
/// machine, torques.
struct Step {
  int n, freedoms;
  const SafetyLimits& limits;
  const SafetyCycle& cycle;
  SafetyShell& shell;

  bool fresh = true;
  Found found = {};
  bool closed() const {  ///< the loop, or it is about to be
    return shell.machine.state == SafetyState::running || shell.machine.stop == StopKind::path;
  }
  const Joint& past(int cycles) const {
    return shell.past[(shell.cycle - static_cast<unsigned>(cycles)) % kMostWindow];
  }
  /// The motors for which a condition holds, as bits.
  template <class Condition>
  std::uint32_t motors(Condition&& condition) const {
    std::uint32_t bits = 0;
    for (int i = 0; i < n; ++i) bits |= static_cast<std::uint32_t>(condition(i)) << i;
    return bits;
  }
  /// The first motor for which a condition holds; n: none.
  template <class Condition>
  int first(Condition&& condition) const {
    for (int i = 0; i < n; ++i)
      if (condition(i)) return i;
    return n;
  }
  template <class Condition>
  void flag(StopCause cause, Condition&& condition) {
    const int motor = first(condition);
    found.add(motor < n, cause, motor);
  }
  /// Flags motors for which a condition has held for too long. Without one there is nothing to add.
  template <class Condition>
  void flag_held(StopCause cause, Real longest, Joint& time, Condition&& condition) {
    const std::uint32_t bit_here = bit_of(cause);
    if (first(condition) == n && !(shell.timed & bit_here)) return;
    shell.timed &= ~bit_here;
    for (int i = 0; i < n; ++i) {
      hold_time(condition(i), limits.period, time[i]);
      if (!(time[i] <= 0)) shell.timed |= bit_here;
    }
    flag(cause, [&](int i) { return time[i] > longest; });
  }

  void check_frame() {
    const int bits = std::clamp(limits.counter_bits, 1, 64);
    note_age(shell.counter.advance(cycle.counter, 1, ~std::uint64_t{0} >> (64 - bits), limits.age));
    note_age(shell.time.advance(cycle.time, limits.period * 1e9, ~std::uint64_t{0}, limits.age));
    const Joint& last = past(1);
    const bool same = first([&](int i) { return cycle.q[i] != last[i] || !number(last[i]); }) == n;
    // Marked frames need no such test: motors that rest under friction look alike.
    if (!shell.follows || !same || cycle.counter.given || cycle.time.given) {
      shell.same = 0;
      return;
    }
    if (!cycle.answer) return;
    if (shell.same == 0)
      for (int i = 0; i < n; ++i) {
        constexpr int kBack = kMostWindow - 1;
        const bool full = shell.have[i] == kMostWindow;
        shell.pace[i] = full ? std::fabs(last[i] - past(kMostWindow)[i]) / kBack : 0;
        shell.frame.begin(i, shell.wanted[i]);
      }
    shell.same = std::min(shell.same + 1, kLongest);
    bool moved = false;
    Real unseen = 0;  // Σ of squares, beyond the count that each motor may move unseen
    for (int i = 0; i < n; ++i) {
      const Real asked = std::fabs(cycle.q_d[i] - shell.frame.from[i]);
      const Real still = limits.still[i], expected = shell.pace[i] * shell.same;
      // A robot at rest may start late, but not one that just moved, faster than by its noise.
      const bool just =
          shell.pace[i] > kLeastPace * still && (shell.same <= kMostWindow || expected < 3 * still);
      const Real beyond = std::min(asked, expected) - kOneCount * still;
      if (just && beyond > 0) unseen += beyond * beyond / (still * still);
      const Real way =
          shell.frame.advance(limits, i, cycle.q_d[i], cycle.error[i], limits.rests[i]);
      moved = moved || !(std::fabs(way) <= still);
    }
    moved = moved || unseen > (1 - kOneCount) * (1 - kOneCount);
    fresh = fresh && !moved;
    found.add(moved && shell.same >= kFrozen, StopCause::stale_frame);
  }

  /// One motor whose reading stands still although its loop drives it.
  void check_stuck() {
    const Joint& last = past(1);
    flag(StopCause::stale_frame, [&](int i) {
      if (!shell.follows || cycle.q[i] != last[i] || cycle.unused & bit(i)) {
        shell.alike &= ~bit(i);
        return false;
      }
      if (!cycle.answer) return false;
      if (!(shell.alike & bit(i))) shell.alone.begin(i, shell.wanted[i]);
      shell.alike |= bit(i);
      const Real way =
          shell.alone.advance(limits, i, cycle.q_d[i], cycle.error[i], limits.rests[i]);
      return shell.alone.cycles[i] >= kFrozen &&
             !(std::fabs(way) <=
               std::max(kStuckStill * limits.still[i], kStuckTracking * limits.tracking[i]));
    });
  }

  void note_age(FrameAge age) {
    fresh = fresh && age == FrameAge::fresh;
    if (age <= FrameAge::repeated) return;
    found.add(age == FrameAge::old, StopCause::stale_frame);
    found.add(age == FrameAge::dropped, StopCause::dropped_frames);
    found.add(age == FrameAge::backwards, StopCause::clock_backwards);
  }

  void check_readings() {
    const std::uint32_t valid = motors([&](int i) { return number(cycle.q[i]); });
    const std::uint32_t used = (bit(n) - 1) & ~cycle.unused, read = valid & used;
    if (read != used || shell.unread) {
      shell.unread = used & ~valid;
      for (int i = 0; i < n; ++i)
        shell.missing[i] = shell.unread & bit(i) ? shell.missing[i] + limits.period : 0;
      flag(StopCause::missing_reading,
           [&](int i) { return !(shell.missing[i] <= limits.missing); });
    }
    flag(StopCause::motor_range, [&](int i) {
      const Real q = cycle.q[i], low = limits.low[i], high = limits.high[i];
      return read & bit(i) && low < high && !(q >= low && q <= high);
    });
    // The difference of two readings is exact to a count, and their noise. A repeated frame may be
    // one end of it: then over as many cycles as there are.
    shell.uneven = fresh ? std::max(shell.uneven - 1, 0) : kMostWindow;
    const int late = shell.uneven > 0 ? limits.age : 0;
    const int window = late ? kMostWindow : std::min(limits.window, kMostWindow);
    const Joint& before = past(window);
    const auto too_fast = [&](int i, Real from, int cycles) {
      const Real most = limits.speed[i] * (limits.period * (cycles + late)) + limits.count[i];
      return !(std::fabs(cycle.q[i] - from) <= most);
    };
    flag(StopCause::overspeed, [&](int i) {
      const int m = shell.have[i];
      return read & bit(i) &&
             (m >= window ? too_fast(i, before[i], window) : m > 0 && too_fast(i, past(m)[i], m));
    });
    for (int i = 0; i < n; ++i) {
      shell.have[i] = read & bit(i) ? std::min(shell.have[i] + 1, kMostWindow) : 0;
    }
    shell.past[shell.cycle % kMostWindow] = cycle.q;
  }

  void check_law() {
    found.add(!closed() && !consistent(limits, n, freedoms), StopCause::contradictory_limits);
    found.add(!cycle.known, StopCause::unknown_pose);
    found.add(cycle.lost, StopCause::suspected_motor);
    found.add(cycle.disagree, StopCause::readings_disagree);
    if (!cycle.answer) {
      shell.unanswered += limits.period;
      found.add(!shell.follows || !(shell.unanswered <= limits.held), StopCause::no_answer);
      return;
    }
    shell.unanswered = 0;
    for (int j = 0; j < freedoms; ++j) {
      const Real x = cycle.x[j], low = limits.box_low[j], high = limits.box_high[j];
      found.add(low < high && !(x >= low && x <= high), StopCause::workspace);
    }
    flag(StopCause::tracking_error,
         [&](int i) { return !(std::fabs(cycle.error[i]) <= limits.tracking[i]); });
    if (fresh)
      flag(StopCause::tracking_error, [&](int i) {
        return shell.have[i] > 0 && !(std::fabs(cycle.q_d[i] - cycle.q[i]) <= limits.deviation[i]);
      });
    if (shell.follows) {
      const Real T = limits.period;
      flag(StopCause::setpoint_speed, [&](int i) {
        return !(std::fabs(cycle.q_d[i] - shell.wanted[i]) <= limits.speed[i] * T);
      });
      flag_held(StopCause::saturation, limits.saturation, shell.saturated,
                [&](int i) { return !(std::fabs(cycle.torque[i]) < limits.torque[i]); });
      flag_held(StopCause::torque_rate, limits.clipped, shell.clipped, [&](int i) {
        return !(std::fabs(cycle.torque[i] - shell.torque[i]) <= limits.slew[i] * T);
      });
    } else {
      shell.saturated = shell.clipped = {};
    }
    const bool stops = shell.machine.stop == StopKind::path;
    const bool halts = stops && first([&](int i) { return cycle.q_d[i] != shell.wanted[i]; }) == n;
    shell.halted = halts ? shell.halted + limits.period : 0;
    shell.wanted = cycle.q_d;
  }

  /// Whether all motors have been read without a gap for as long as their speeds are measured.
  bool seen() const {
    return std::all_of(shell.have.begin(), shell.have.begin() + n,
                       [](int have) { return have == kMostWindow; });
  }

  /// One transition. @return whether the state has changed
  bool transit() {
    const SafetyRequests& request = cycle.request;
    const SafetyMachine before = shell.machine;
    shell.refused = StopCause::none;
    const bool requested = request.start || request.stop || request.acknowledge;
    if (before.state == SafetyState::running && !found.causes && !requested) {  // as usual
      shell.started = shell.acknowledged = false;
      shell.since += limits.period;
      return false;
    }
    SafetyFindings now;
    now.start = request.start && !shell.started;
    now.acknowledge = request.acknowledge && !shell.acknowledged;
    now.stop = request.stop;
    shell.started = request.start;
    shell.acknowledged = request.acknowledge;
    constexpr std::uint32_t always = causes_with(&CauseProperties::always);
    constexpr std::uint32_t by_path = causes_with(&CauseProperties::by_path);
    const std::uint32_t violations = closed() ? found.causes : found.causes & always;
    now.violated = violations != 0;
    now.trusted =
        !(found.causes & ~by_path) && !cycle.suspected && cycle.answer && fresh && shell.follows;
    now.path_ended = shell.since >= limits.stop || shell.halted >= limits.brake;
    now.brakes_closed = shell.since >= limits.brake + limits.standstill;
    // Only a start or an acknowledgement needs more than the absence of a violation.
    if (now.start || now.acknowledge) {
      found.add(!seen(), StopCause::unknown_pose);
      now.healthy = found.causes == 0 && fresh;
    }
    shell.machine = next(before, now);
    const SafetyState state = shell.state = shell.machine.state;
    const bool ready = state == SafetyState::ready, runs = state == SafetyState::running;
    if ((now.acknowledge && !ready && !runs) || (now.start && !runs))
      shell.refused = found.causes   ? found.first()
                      : !fresh       ? StopCause::stale_frame
                      : request.stop ? StopCause::requested
                                     : StopCause::not_ready;
    if (violations) remember(violations);
    if (before.state == SafetyState::running && now.stop && !violations)
      remember(bit_of(StopCause::requested));
    if (ready && before.state != state) {
      shell.causes = 0;
      shell.cause = StopCause::none;
      shell.part = -1;
    }
    const bool same_stop = before.state == state && before.stop == shell.machine.stop;
    shell.since = same_stop ? shell.since + limits.period : 0;
    return !same_stop;
  }

  /// The first violation is the cause, before it a request.
  void remember(std::uint32_t causes) {
    if (!(shell.causes & ~bit_of(StopCause::requested))) {
      shell.cause = Found{causes, {}}.first();
      shell.part = shell.cause == StopCause::requested
                       ? -1
                       : found.part[static_cast<std::size_t>(shell.cause)];
    }
    shell.causes |= causes;
  }

  /// Torques and brakes of the state. @return whether all torques are what is wanted
  bool set_torques(const Joint& target) {
    const bool within =
        first([&](int i) {  // as usual
          return !(std::fabs(target[i]) <= limits.torque[i] &&
                   std::fabs(target[i] - shell.torque[i]) <= limits.slew[i] * limits.period);
        }) == n;
    if (within) {
      std::copy_n(target.begin(), n, shell.torque.begin());
      return true;
    }
    bool reached = true;
    for (int i = 0; i < n; ++i) {
      const Real most = limits.torque[i] > 0 ? limits.torque[i] : 0;
      const Real step = limits.slew[i] * limits.period > 0 ? limits.slew[i] * limits.period : 0;
      const Real now = shell.torque[i];
      const Real wanted = std::isfinite(target[i]) ? target[i] : now;
      const Real bounded = std::clamp(wanted, -most, most);
      const Real way = bounded - now;  // exact where it ends, no sum of roundings
      shell.torque[i] = std::fabs(way) <= step ? bounded : now + std::copysign(step, way);
      reached = reached && shell.torque[i] == bounded;
    }
    return reached;
  }
};
}  // namespace

void guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
           SafetyShell& shell) {
  const int n = robot.motors;
  Step step{n, dof(robot.mobility), limits, cycle, shell};
  ++shell.cycle;
  step.check_frame();
  step.check_stuck();
  step.check_readings();
  step.check_law();
  const bool began = step.transit();
  const SafetyMachine& machine = shell.machine;
  const bool runs = machine.state == SafetyState::running;
  const bool braking = machine.stop == StopKind::brake;

  shell.follows = shell.follows && step.closed();
  if (cycle.answer && step.fresh && (shell.follows || runs)) shell.at = cycle.x;
  if (began && (runs || braking)) {
    Joint weight{};
    if (inverse_dynamics(robot, to_pose(robot.mobility, shell.at), {}, {}, weight))
      shell.weight = weight;
    shell.opening = 0;
  }
  if (shell.follows) {
    const bool closes = cycle.answer && step.fresh;
    step.set_torques(closes ? cycle.torque : cycle.load);
  } else if (runs) {
    // The brakes open once the motors hold the weight, and the law acts once they have opened.
    if (step.set_torques(shell.weight)) shell.opening += limits.period;
    shell.follows = shell.opening > limits.brake;
  } else {
    step.set_torques(braking ? shell.weight : Joint{});
  }
  const bool open = shell.follows || (runs && shell.opening > 0);
  shell.brakes = open ? 0 : bit(n) - 1;
  shell.path_stop = machine.stop == StopKind::path ? limits.stop : 0;
}
}  // namespace truepose
