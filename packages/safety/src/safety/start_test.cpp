// The start-up test: proves every reading before a law may act.
#include "safety/start_test.hpp"

#include "control/dynamics.hpp"
#include "safety/start_pulse.hpp"
#include "safety/start_rest.hpp"

namespace truepose {
namespace start_detail {
namespace {
constexpr int kAveraged = 8;   ///< cycles of an average between pulses,
constexpr int kRested = 32;    ///< and at rest
constexpr Real kRings = 0.03;  ///< s for which they must stand still, but wait no longer
constexpr Real kRung = 0.15;   ///< than this: compliant arms ring after their brakes closed
constexpr Real kMost = 1e9;    ///< rad or m: larger readings are missing

/// One cycle of a robot's test.
class StartCycle {
 public:
  StartCycle(const Robot& robot, const StartSettings& settings, const SafetyLimits& limits,
             const Extended& q_e, const Weighing& weighing, StartTest& test)
      : robot_(robot),
        settings_(settings),
        limits_(limits),
        q_e_(q_e),
        weighing_(weighing),
        test_(test) {}

  void run(bool known) {
    test_.since += limits_.period;
    if (test_.state < StartState::passed && check(known)) advance();
    Joint wanted{};
    wanted[i()] = target();
    approach(limits_, n, wanted, test_.torque);
    test_.brakes = bit(n) - 1;
    if (test_.state == StartState::open) test_.brakes &= ~bit(test_.motor);
  }

 private:
  int e() const { return n + robot_.r; }
  int i() const { return test_.motor; }
  Real opens() const { return settings_.brake_opens < 0 ? limits_.brake : settings_.brake_opens; }
  Real friction(int motor) const {
    const Real own = settings_.friction[motor], file = robot_.chain[motor].coulomb;
    return own > 0 ? own : file > 0 ? file : Real(0.005) * limits_.torque[motor];
  }
  /// Largest error of a difference of two readings.
  Real count(int c) const {
    if (c < n) return limits_.count[c];
    const Sensor& sensor = robot_.sensor[c - n];
    return sensor.step + 8 * std::sqrt(Real(2)) * sensor.noise + by_precision(1e-9, 1e-5);
  }
  Real change(int c, Real from, Real to) const { return within_turn(robot_, c, to - from); }

  void go(StartState state) {
    test_.state = state;
    test_.since = 0;
    test_.index = test_.samples = 0;
    test_.sum.fill(0);
  }
  void fail(StartFinding finding, int part = -1, int other = -1) {
    go(StartState::failed);
    test_.finding = finding;
    test_.part = part;
    test_.other = other;
  }
  void fail(const StartHypothesis& by) {
    if (by.kind != StartFinding::scale) return fail(by.kind, by.a, by.b);
    StartGain gain;
    misfit(test_.evidence, n, e(), by, gain);
    fail(named(gain.value, seen(by.a)), by.a);
  }

  /// Whether the test may go on: limits, pose, and numbers.
  bool check(bool known) {
    const bool sound = robot_.finished && !overdriven(robot_) && consistent(limits_, n, n) &&
                       settings_.motion > 0 && settings_.pulse > 0 && settings_.inertia >= 1 &&
                       settings_.weight >= 0 && settings_.radius >= 0 && settings_.pairs >= 0 &&
                       settings_.settle >= 0;
    if (!sound) return fail(StartFinding::contradictory_limits), false;
    if (!known) return fail(StartFinding::unknown_pose), false;
    bool numbers = true;
    for (int c = 0; c < e(); ++c) {
      const bool number = std::fabs(q_e_[c]) < kMost;
      test_.missing[c] = number ? 0 : test_.missing[c] + limits_.period;
      numbers = numbers && number;
      if (test_.missing[c] > limits_.missing) return fail(StartFinding::missing, c), false;
    }
    return numbers || test_.state == StartState::open;
  }

  void advance() {
    switch (test_.state) {
      case StartState::rest: return rest();
      case StartState::explain: return explain();
      case StartState::load: return load();
      case StartState::open: return open();
      case StartState::close: return close();
      case StartState::judge: return weigh_hypothesis();
      default: return unload();
    }
  }

  /// Averages the readings. @return whether `count` cycles are in
  bool averaged(int count, Extended& mean) {
    for (int c = 0; c < e(); ++c) {
      if (test_.samples == 0) mean[c] = test_.low[c] = test_.high[c] = q_e_[c];
      test_.sum[c] += change(c, mean[c], q_e_[c]);
      test_.low[c] = std::min(test_.low[c], q_e_[c]);
      test_.high[c] = std::max(test_.high[c], q_e_[c]);
    }
    if (++test_.samples < count) return false;
    for (int c = 0; c < e(); ++c) mean[c] += test_.sum[c] / test_.samples;
    test_.samples = 0;
    test_.sum.fill(0);
    return true;
  }

  /// Averages readings between pulses. @return whether they stand still, or have rung for too long
  bool settled(Extended& mean) {
    const Real cycles = std::min(kRings / limits_.period, Real(1000));
    if (!averaged(std::max(kAveraged, static_cast<int>(cycles)), mean)) return false;
    bool still = true;
    for (int c = 0; c < e(); ++c) still = still && test_.high[c] - test_.low[c] <= count(c);
    return still || test_.since > kRung;
  }

  void rest() {
    if (test_.since <= limits_.brake + settings_.settle || !averaged(kRested, test_.begin)) return;
    for (int c = 0; c < e(); ++c)
      if (!(test_.high[c] - test_.low[c] <= 2 * count(c))) return fail(StartFinding::moving, c);
    int outside = -1;
    test_.misfit.fill(INFINITY);
    Pose pose;
    test_.misfit[0] = rest_level(robot_, limits_, weighing_, test_.begin, pose, outside);
    if (test_.misfit[0] <= most(robot_.r))
      return settings_.pairs > 0 ? start(pose) : go(StartState::passed);
    if (robot_.r > 0 && weighing_) return go(StartState::explain);
    if (outside >= 0) return fail(StartFinding::out_of_range, outside);
    fail(StartFinding::unknown_pose);
  }

  Real most(int freedom) const { return chi2_beyond(settings_.false_alarm, freedom); }

  /// One miswiring a cycle: whether the readings are consistent with it undone.
  void explain() {
    if (++test_.index < hypotheses(n, e()) - 2 * n) {
      const StartHypothesis by = hypothesis(n, e(), test_.index);
      Extended q_e = test_.begin;
      if (by.kind == StartFinding::scale)
        q_e[by.a] = -q_e[by.a];
      else
        std::swap(q_e[by.a], q_e[by.b]);
      Pose pose;
      int outside;
      if (by.kind == StartFinding::scale || same_unit(robot_, by.a, by.b))
        test_.misfit[test_.index] = rest_level(robot_, limits_, weighing_, q_e, pose, outside);
      return;
    }
    StartHypothesis by = verdict(test_, robot_, most(robot_.r), test_.candidates);
    if (by.kind == StartFinding::scale) by.kind = StartFinding::reversed;
    fail(by.kind, by.a, by.b);
  }

  /// Pushes and opening times of all motors at the pose at rest.
  void start(const Pose& pose) {
    Closure closure;
    DynamicModel model;
    Parity parity;
    Outcome outcome = parity.look(robot_, pose, {});
    if (outcome) outcome = ikm(robot_, pose, closure);
    if (outcome) outcome = dynamic_model(robot_, closure, {}, model);
    if (!outcome) return fail(StartFinding::unknown_pose);
    const auto& J = parity.jacobians.J;
    const Square inertia = joint_inertia(model, J);
    test_.weight = inverse_dynamics(model, J, {});
    for (int m = 0; m < n; ++m) {
      Real sum = 0;
      for (int j = 0; j < n; ++j) {
        const Real radius = j < positions_of(robot_.mobility) && !is_rotational(robot_.mobility)
                                ? 1
                                : settings_.radius;
        sum += radius * radius * J[j][m] * J[j][m];
      }
      test_.lever[m] = std::sqrt(sum);
      test_.response[m] = 1 / (model.slope[m] * inertia[m][m]);
      const StartPulse pulse = pulse_within(
          settings_, limits_.period,
          {limits_.torque[m], std::fabs(test_.weight[m]), friction(m), std::fabs(test_.response[m]),
           test_.lever[m], robot_.chain[m].actuator == Actuator::revolute});
      test_.push[m] = pulse.push;
      test_.longest[m] = pulse.longest;
      const Real seen = moves(m, test_.longest[m]);
      const bool fine =
          test_.push[m] > 2 * friction(m) && seen >= count(m) && test_.longest[m] > late();
      if (!fine) return fail(StartFinding::too_coarse, m);
    }
    StartEvidence& evidence = test_.evidence;
    evidence = {};
    for (int k = 0; k < robot_.r; ++k) std::copy_n(parity.g[k].begin(), n, evidence.g[k].begin());
    for (int c = 0; c < e(); ++c) {
      const bool motor = c < n;
      const Real step = motor ? robot_.chain[c].encoder_step : robot_.sensor[c - n].step;
      const Real noise = motor ? robot_.chain[c].encoder_noise : robot_.sensor[c - n].noise;
      evidence.step[c] = 2 * noise < step ? step : 0;
      evidence.variance[c] = step * step / 6 + 2 * noise * noise / kAveraged;
      evidence.variance[c] += by_precision(1e-16, 1e-10);  // rounding
    }
    test_.motor = 0;
    begin_motor();
  }

  /// Cycles by which a brake closes later than it opens: for which it is open at least.
  int late() const {
    return std::max(0, static_cast<int>(std::lround((limits_.brake - opens()) / limits_.period)));
  }
  /// Model motion of motor m's reading by a push, while its brake is open for some cycles.
  Real moves(int m, int cycles) const {
    const Real time = cycles * limits_.period;
    const Real net = std::max(test_.push[m] - friction(m), Real{0});
    return Real(0.5) * std::fabs(test_.response[m]) * net * time * time;
  }

  void begin_motor() {
    test_.open = std::max({1, test_.longest[i()] / 4, late() + 1});
    test_.side = 1;
    test_.level = 0;
    test_.trim = 0;
    test_.trimmed.fill(0);
    test_.sunk.fill(0);
    test_.evidence.moved[i()].fill(0);
    test_.evidence.expected[i()] = test_.evidence.pulses[i()] = 0;
    test_.begin = q_e_;
    go(StartState::load);
  }

  /// Motion of the motor that a motion of reading c shows, as motion of the platform, m.
  Real shown(int c, Real change) const {
    Real most = c < n;
    for (int j = 0; c >= n && j < n; ++j)
      most = std::max(most, std::fabs(test_.evidence.g[c - n][j]));
    return most > 0 ? std::max(std::fabs(change) - count(c), Real{0}) / most * test_.lever[i()] : 0;
  }
  /// Largest motion since some readings that any reading shows.
  Real farthest(const Extended& from) const {
    Real most = 0;
    for (int c = 0; c < e(); ++c) most = std::max(most, shown(c, change(c, from[c], q_e_[c])));
    return most;
  }

  void load() {
    if (farthest(test_.begin) > settings_.motion) return judge_now();
    const Real reached = test_.torque[i()] - target();
    if (!(std::fabs(reached) <= limits_.slew[i()] * limits_.period) ||
        test_.since <= settings_.settle || !settled(test_.before))
      return;
    go(StartState::open);
  }

  void open() {
    const int early = static_cast<int>(std::lround((opens() - limits_.brake) / limits_.period));
    const int cycles = std::max(1, test_.open + early);
    if (test_.since >= (cycles - Real(0.5)) * limits_.period ||
        !(farthest(test_.before) <= 2 * settings_.motion))
      go(StartState::close);
  }

  void close() {
    if (test_.since <= limits_.brake + opens() + settings_.settle) return;
    if (!settled(test_.after)) return;
    Extended y{};
    for (int c = 0; c < e(); ++c) y[c] = change(c, test_.before[c], test_.after[c]);
    StartEvidence& evidence = test_.evidence;
    for (int c = 0; c < e(); ++c) evidence.moved[i()][c] += test_.side * y[c];
    evidence.expected[i()] += moves(i(), test_.open);
    evidence.pulses[i()] += 1;
    if (test_.side > 0) {
      test_.forward = y;
      test_.from = test_.before;
      test_.side = -1;
      return go(StartState::load);
    }
    test_.side = 1;
    pair(y);
  }

  /// After two opposite pulses: decides on the next two.
  void pair(const Extended& back) {
    Real most = 0, clearest = 0, ratio = 0;
    for (int c = 0; c < e(); ++c) {
      const Real apart = test_.forward[c] - back[c];
      // The torque's way back counts, except for the first two pulses, which begin at the other
      // side: closed brakes are elastic, and what they do in every pair does not add up.
      const bool first = test_.evidence.pulses[i()] == 2;
      test_.sunk[c] +=
          first ? test_.forward[c] + back[c] : change(c, test_.closed[c], test_.after[c]);
      test_.closed[c] = test_.after[c];
      // The mean of both directions: closed brakes are elastic.
      const Real gone =
          (change(c, test_.begin[c], test_.from[c]) + change(c, test_.begin[c], test_.after[c])) /
          2;
      const auto beyond = [&](Real way) { return way - std::clamp(way, -count(c), count(c)); };
      most = std::max({most, shown(c, test_.forward[c]), shown(c, back[c])});
      test_.trimmed[c] += apart * test_.trim / test_.push[i()];
      if (shown(c, apart) <= clearest || std::fabs(apart) < Real(1.9) * count(c)) continue;
      clearest = shown(c, apart);
      const Real all = test_.evidence.moved[i()][c];
      ratio = beyond(gone - test_.trimmed[c]) / all + beyond(gone) / (2 * apart);
    }
    // The weight's error by all pulses so far, and half of the way back. Neither sign nor scale of
    // the reading matters.
    const Real room = limits_.torque[i()] - test_.push[i()] - std::fabs(test_.weight[i()]);
    test_.trim = -std::clamp(ratio * test_.push[i()], -room, room);

    for (int j = 0; j < n; ++j)
      if (j != i() && slips(j)) return judge_now();
    const int longest = test_.longest[i()];
    const bool enough = most * 4 >= settings_.motion || test_.open >= longest;
    if (most > settings_.motion || farthest(test_.begin) > settings_.motion) return judge_now();
    if (enough && (++test_.level >= settings_.pairs || (most == 0 && test_.level > 1)))
      return judge_now();
    // At most twice as long, and never farther than two opposite pulses may be.
    const Real coarse = 2 * count(i()) * test_.lever[i()];
    const Real longer = std::min(std::sqrt(settings_.motion / (most + coarse)), Real(2));
    if (!enough)
      test_.open = std::clamp(static_cast<int>(longer * test_.open), test_.open + 1, longest);
    go(StartState::load);
  }

  void judge_now() {
    test_.evidence.tested = i() + 1;
    go(StartState::judge);
    bool any = false, sinks = false;
    for (int c = 0; c < e(); ++c) {
      const Real variance = kBetter * test_.evidence.noise(i(), c);
      const Real y = test_.evidence.moved[i()][c];
      any = any || y * y > variance;
      sinks = sinks || test_.sunk[c] * test_.sunk[c] > variance;
    }
    if (test_.evidence.pulses[i()] == 0)
      fail(StartFinding::brake_slips, i());
    else if (!any)
      fail(sinks ? StartFinding::no_torque : StartFinding::no_motion, i());
  }

  void weigh_hypothesis() {
    const int all = hypotheses(n, e());
    StartGain gain;
    const StartHypothesis by = hypothesis(n, e(), test_.index);
    test_.misfit[test_.index] = misfit(test_.evidence, n, e(), by, gain);
    if (by.kind == StartFinding::scale) {
      test_.scale[by.a] = gain.value;
      test_.sigma[by.a] = gain.sigma;
      // Any scale explains as much as one miswiring by chance.
      if (named(gain.value, seen(by.a)) == StartFinding::scale)
        test_.misfit[test_.index] += kBetter;
    }
    if (++test_.index < all) return;
    const Real most = chi2_beyond(1e-6, test_.evidence.tested * (e() - 1) + 1);
    const StartHypothesis found = verdict(test_, robot_, most, test_.candidates);
    const bool last = i() + 1 == n;
    for (int j = 0; j < n; ++j)
      if (j != i() && found.kind == StartFinding::none && slips(j))
        return fail(StartFinding::brake_slips, j);
    const bool far = farthest(test_.begin) > settings_.motion;
    if (found.kind != StartFinding::none && (found.kind != StartFinding::inconsistent || last))
      return fail(found);
    const Real pushed = std::fabs(test_.evidence.moved[i()][i()]);
    if (far && std::fabs(test_.sunk[i()]) > 2 * pushed) return fail(StartFinding::no_torque, i());
    if (far) return fail(StartFinding::too_far, i());
    if (last) {
      note_exchangeable();
      for (int c = 0; c < e(); ++c)
        if (!seen(c)) return fail(StartFinding::unseen, c);
    }
    go(StartState::unload);
  }

  /// Whether motor j moved for good though its brake was closed.
  bool slips(int j) const {
    const Real moved = std::fabs(test_.evidence.moved[i()][i()]);
    return std::fabs(test_.sunk[j]) > 3 * count(j) + kGive * moved;
  }
  bool seen(int c) const {
    Real sum = 0;
    for (int m = 0; m < test_.evidence.tested; ++m) {
      const Real y = test_.evidence.moved[m][c];
      sum += y * y / test_.evidence.noise(m, c);
    }
    return sum > kSeen * kSeen;
  }
  void note_exchangeable() {
    test_.exchangeable = 0;
    for (int k = 1; k < hypotheses(n, e()); ++k) {
      const StartHypothesis by = hypothesis(n, e(), k);
      if (by.kind == StartFinding::exchanged && same_unit(robot_, by.a, by.b) &&
          test_.misfit[k] < test_.misfit[0] + kBetter)
        test_.exchangeable |= bit(by.a) | bit(by.b);
    }
  }

  void unload() {
    if (test_.torque[i()] != 0) return;
    if (i() + 1 == n) return go(StartState::passed);
    ++test_.motor;
    begin_motor();
  }

  Real target() const {
    switch (test_.state) {
      case StartState::load:
      case StartState::open:
      case StartState::close: {
        const Real sign = test_.response[i()] > 0 ? 1 : -1;
        return test_.weight[i()] + sign * (test_.trim + test_.side * test_.push[i()]);
      }
      case StartState::judge: return test_.torque[i()];
      // After a failure the torque stays until the brake has closed.
      case StartState::failed: return test_.since <= limits_.brake ? test_.torque[i()] : 0;
      default: return 0;
    }
  }

  const Robot& robot_;
  const int n = robot_.motors;
  const StartSettings& settings_;
  const SafetyLimits& limits_;
  const Extended& q_e_;
  const Weighing& weighing_;
  StartTest& test_;
};
}  // namespace
}  // namespace start_detail

void start_test(const Robot& robot, const StartSettings& settings, const SafetyLimits& limits,
                const Extended& q_e, bool known, StartTest& test, const Weighing& weighing) {
  start_detail::StartCycle(robot, settings, limits, q_e, weighing, test).run(known);
}
}  // namespace truepose
