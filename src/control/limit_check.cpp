// Checks of a control cycle against its limits.
#include "control/limit_check.hpp"

namespace truepose {
void Violations::add(bool violated, StopCause cause, int motor) {
  if (!violated) return;
  if (!(causes & bit_of(cause))) part[std::size_t(cause)] = motor;
  causes |= bit_of(cause);
}

bool LimitState::seen(int motors) const {
  return std::all_of(have.begin(), have.begin() + motors,
                     [](int valid) { return valid == kMostWindow; });
}

namespace {
using namespace safety_detail;

constexpr Real kOneCount = 1.0 / 3;  ///< that motion leaves unseen, over `still`
/// One motor stands still while its loop drives it: ways over `still` and over `tracking`, the
/// larger of which is too far.
constexpr Real kStuckStill = 7, kStuckTracking = 0.1;

/// Adds or takes off a period of a time that a condition has held.
void hold_time(bool holds, Real period, Real& time) {
  time = max(time + (holds ? period : -period), Real{0});
}

/// The checks of one cycle.
struct Check {
  int n, freedoms;
  const SafetyLimits& limits;
  const CheckedCycle& cycle;
  const bool acts;
  const Joint& applied;
  LimitState& state;

  Violations found = {};

  const Joint& past(int cycles) const {
    return state.past[(state.cycle - unsigned(cycles)) % kMostWindow];
  }
  Real advance(DrivenWay& way, int i) const {
    return way.advance(limits.period, limits.kp[i], limits.kd[i], cycle.q_d[i], cycle.error[i],
                       limits.rests[i]);
  }
  /// The motors for which a condition holds, as bits.
  template <class Condition>
  std::uint32_t motors(Condition&& condition) const {
    std::uint32_t bits = 0;
    for (int i : range(n)) bits |= std::uint32_t(condition(i)) << i;
    return bits;
  }
  /// The first motor for which a condition holds; n: none.
  template <class Condition>
  int first(Condition&& condition) const {
    for (int i : range(n))
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
    if (first(condition) == n && !(state.timed & bit_here)) return;
    state.timed &= ~bit_here;
    for (int i : range(n)) {
      hold_time(condition(i), limits.period, time[i]);
      if (!(time[i] <= 0)) state.timed |= bit_here;
    }
    flag(cause, [&](int i) { return time[i] > longest; });
  }

  void check_frame() {
    const int bits = clamp(limits.counter_bits, 1, 64);
    note_age(state.counter.advance(cycle.counter, 1, ~std::uint64_t{0} >> (64 - bits), limits.age));
    note_age(state.time.advance(cycle.time, limits.period * 1e9, ~std::uint64_t{0}, limits.age));
    const Joint& last = past(1);
    const bool same = first([&](int i) { return cycle.q[i] != last[i] || !number(last[i]); }) == n;
    // Marked frames need no such test: motors that rest under friction look alike.
    if (!acts || !same || cycle.counter.given || cycle.time.given) {
      state.same = 0;
      return;
    }
    if (!cycle.answer) return;
    if (state.same == 0)
      for (int i : range(n)) {
        constexpr int kBack = kMostWindow - 1;
        const bool full = state.have[i] == kMostWindow;
        state.pace[i] = full ? fabs(last[i] - past(kMostWindow)[i]) / kBack : 0;
        state.frame[i] = {state.wanted[i]};
      }
    state.same = min(state.same + 1, kMostCounted);
    bool moved = false;
    Real unseen = 0;  // Σ of squares, beyond the count that each motor may move unseen
    for (int i : range(n)) {
      const Real asked = fabs(cycle.q_d[i] - state.frame[i].from);
      const Real still = limits.still[i], expected = state.pace[i] * state.same;
      // A robot at rest may start late, but not one that just moved, faster than by its noise.
      const bool just =
          state.pace[i] > kLeastPace * still && (state.same <= kMostWindow || expected < 3 * still);
      const Real beyond = min(asked, expected) - kOneCount * still;
      if (just && beyond > 0) unseen += beyond * beyond / (still * still);
      const Real way = advance(state.frame[i], i);
      moved = moved || !(fabs(way) <= still);
    }
    moved = moved || unseen > (1 - kOneCount) * (1 - kOneCount);
    found.fresh = found.fresh && !moved;
    found.add(moved && state.same >= kFrozen, StopCause::stale_frame);
  }

  /// One motor whose reading stands still although its loop drives it.
  void check_stuck() {
    const Joint& last = past(1);
    flag(StopCause::stale_frame, [&](int i) {
      if (!acts || cycle.q[i] != last[i] || cycle.unused & bit(i)) {
        state.alike &= ~bit(i);
        return false;
      }
      if (!cycle.answer) return false;
      if (!(state.alike & bit(i))) state.alone[i] = {state.wanted[i]};
      state.alike |= bit(i);
      const Real way = advance(state.alone[i], i);
      return state.alone[i].cycles >= kFrozen &&
             !(fabs(way) <=
               max(kStuckStill * limits.still[i], kStuckTracking * limits.tracking[i]));
    });
  }

  void note_age(FrameAge age) {
    found.fresh = found.fresh && age == FrameAge::fresh;
    if (age <= FrameAge::repeated) return;
    found.add(age == FrameAge::old, StopCause::stale_frame);
    found.add(age == FrameAge::dropped, StopCause::dropped_frames);
    found.add(age == FrameAge::backwards, StopCause::clock_backwards);
  }

  void check_readings() {
    const std::uint32_t valid = motors([&](int i) { return number(cycle.q[i]); });
    const std::uint32_t used = (bit(n) - 1) & ~cycle.unused, read = valid & used;
    if (read != used || state.unread) {
      state.unread = used & ~valid;
      for (int i : range(n))
        state.missing[i] = state.unread & bit(i) ? state.missing[i] + limits.period : 0;
      flag(StopCause::missing_reading,
           [&](int i) { return !(state.missing[i] <= limits.missing); });
    }
    flag(StopCause::motor_range, [&](int i) {
      const Real q = cycle.q[i], low = limits.low[i], high = limits.high[i];
      return read & bit(i) && low < high && !(q >= low && q <= high);
    });
    // The difference of two readings is exact to a count, and their noise. A repeated frame may be
    // one end of it: then over as many cycles as there are.
    state.uneven = found.fresh ? max(state.uneven - 1, 0) : kMostWindow;
    const int late = state.uneven > 0 ? limits.age : 0;
    const int window = late ? kMostWindow : min(limits.window, kMostWindow);
    const Joint& before = past(window);
    const auto too_fast = [&](int i, Real from, int cycles) {
      const Real most = limits.speed[i] * (limits.period * (cycles + late)) + limits.count[i];
      return !(fabs(cycle.q[i] - from) <= most);
    };
    flag(StopCause::overspeed, [&](int i) {
      const int m = state.have[i];
      return read & bit(i) &&
             (m >= window ? too_fast(i, before[i], window) : m > 0 && too_fast(i, past(m)[i], m));
    });
    for (int i : range(n)) {
      state.have[i] = read & bit(i) ? min(state.have[i] + 1, kMostWindow) : 0;
    }
    state.past[state.cycle % kMostWindow] = cycle.q;
  }

  void check_law() {
    if (!cycle.answer) {
      state.unanswered += limits.period;
      found.add(!acts || !(state.unanswered <= limits.held), StopCause::no_answer);
      return;
    }
    state.unanswered = 0;
    for (int j : range(freedoms)) {
      const Real x = cycle.x[j], low = limits.box_low[j], high = limits.box_high[j];
      found.add(low < high && !(x >= low && x <= high), StopCause::workspace);
    }
    flag(StopCause::tracking_error,
         [&](int i) { return !(fabs(cycle.error[i]) <= limits.tracking[i]); });
    if (found.fresh)
      flag(StopCause::tracking_error, [&](int i) {
        return state.have[i] > 0 && !(fabs(cycle.q_d[i] - cycle.q[i]) <= limits.deviation[i]);
      });
    if (acts) {
      const Real T = limits.period;
      flag(StopCause::setpoint_speed,
           [&](int i) { return !(fabs(cycle.q_d[i] - state.wanted[i]) <= limits.speed[i] * T); });
      flag_held(StopCause::saturation, limits.saturation, state.saturated,
                [&](int i) { return !(fabs(cycle.torque[i]) < limits.torque[i]); });
      flag_held(StopCause::torque_rate, limits.clipped, state.clipped,
                [&](int i) { return !(fabs(cycle.torque[i] - applied[i]) <= limits.slew[i] * T); });
    } else {
      state.saturated = state.clipped = {};
    }
    state.wanted = cycle.q_d;
  }
};
}  // namespace

Violations check_limits(int motors, int freedoms, const SafetyLimits& limits,
                        const CheckedCycle& cycle, bool acts, const Joint& applied,
                        LimitState& state) {
  Check check{motors, freedoms, limits, cycle, acts, applied, state};
  ++state.cycle;
  check.check_frame();
  check.check_stuck();
  check.check_readings();
  check.check_law();
  return check.found;
}
}  // namespace truepose
