// Detection and isolation of faulty readings (FDI).
//
// Four questions a cycle. Alone: is a reading a number, within its range, no faster than the motors
// can make it, and does it change while the robot moves? Together: is the parity (parity.hpp)
// larger than readings and geometry allow (the level)? What the geometry adds to it changes with
// the pose alone, slowly; the innovation of a tracker of the parity has little more than the
// readings' own noise, and sees what comes at once far below the level (the change).
//
// A reading whose being wrong would leave too much of χ² cannot be the one. Of those that may be,
// one that stands still while the robot moves, or that alone leaves its own track, is named; as
// long as there are several, they are suspected together. (Willsky and Jones, A generalized
// likelihood ratio approach to the detection and estimation of jumps in linear systems, 1976.)
//
// A reading that is not believed is replaced: by its own prediction for some cycles, afterwards by
// what the others say it should be, its own error taken as unknown. Bounded work, no allocation.
#pragma once

#include "truepose/control/fault_monitor_state.hpp"
#include "truepose/control/multirate.hpp"
#include "truepose/control/parity.hpp"

namespace truepose {

namespace watch_detail {

/// One cycle of the watch.
template <Mobility K>
class Cycle {
 public:
  static constexpr int n = kDof<K>;

  Cycle(const Robot& robot, const FaultMonitorSettings& settings, const Weighing& weighing,
        const Joint& desired, const Extended& q_e, FaultMonitor& watch, Extended& believed,
        Multirate* late)
      : robot_(robot),
        settings_(settings),
        weighing_(weighing),
        desired_(desired),
        q_e_(q_e),
        watch_(watch),
        believed_(believed),
        late_(late),
        r_(robot.r),
        rows_(n + robot.r),
        settled_(watch.cycle - watch.began > kSettling) {
    for (int c = 0; c < rows_; ++c) {
      const Real sigma = weighing.known->sigma[c];
      noise_[c] = sigma * sigma;
    }
  }

  Outcome run() {
    // It begins with the first readings that have a pose: before, nothing can stand for a motor.
    const bool first_cycle = watch_.cycle == 0;
    for (int c = 0; first_cycle && c < n; ++c)
      if (!number(q_e_[c])) {
        watch_.reading[c].health = Health::suspect;
        watch_.reading[c].symptom = Symptom::missing;
        return {Status::not_finite, c};
      }
    alone(0, n);
    if (late_) bring_late_up();
    alone(n, rows_);
    const Outcome placed = place();
    if (!placed && first_cycle) return placed;
    if (!placed && watch_.cycle == watch_.began) ++watch_.began;
    if (placed) {
      for (int c = 0; c < rows_; ++c)
        if (without_ & bit(c)) leave_out(c);
      if (r_ > 0 && settled_) together();
      if (without_) replace();
      watch_.last = watch_.motion;
      watch_.motion = watch_.placed ? difference<K>(parity_.pose, watch_.pose) : Coordinates{};
      watch_.pose = parity_.pose;
    }
    watch_.placed = bool(placed);
    const int first = follow();
    if (placed && r_ > 0 && stale()) watch_.known = bool(refresh());
    ++watch_.cycle;
    if (!placed) return placed;
    return {first < 0 ? Status::ok : Status::disagree, first};
  }

 private:
  /// Multirate readings become present ones, by the motors that are believed.
  void bring_late_up() {
    Extended by = q_e_;
    std::copy_n(believed_.begin(), n, by.begin());
    if (!compensate_latency<K>(robot_, *late_, by)) return;
    std::copy_n(by.begin() + n, r_, q_e_.begin() + n);
    bool motors = true;  // only what is prompt may stand for one
    for (int c = 0; c < n; ++c) motors = motors && watch_.reading[c].health != Health::failed;
    for (int c = 0; c < rows_; ++c) {
      if (late(c) && !motors) {
        noise_[c] = 1;
      } else if (late(c)) {
        noise_[c] += late_detail::latency_variance(*late_, c - n, late_->before[c - n]);
      } else if (c < n && leaves_track(c, innovation_[c])) {
        watch_.reading[c].left = watch_.cycle;
      }
    }
  }

  /// Each reading by itself.
  void alone(int begin, int end) {
    for (int c = begin; c < end; ++c) {
      MonitoredReading& reading = watch_.reading[c];
      if (!reading.begun && number(q_e_[c])) {
        reading.begun = true;
        reading.own = {q_e_[c], 0};
        reading.raw = q_e_[c];
        reading.model = c < n ? desired_[c] : q_e_[c];
        if (c < n) reading.usual = desired_[c] - q_e_[c];
      }
      const Real predicted = reading.own.predicted(settings_.period);
      const Real news = q_e_[c] - predicted;
      innovation_[c] = within_turn(robot_, c, news);
      // The turns that an encoder has lost, or passed, since it began are nothing that moved.
      believed_[c] = innovation_[c] == news ? q_e_[c] : predicted + innovation_[c];
      if (reading.health != Health::failed) {
        const Symptom symptom = symptom_of(c);
        if (symptom == Symptom::none) continue;
        bridge(settings_, watch_.cycle, symptom, every(c), reading);
        if (!reading.begun) reading.health = Health::failed;  // by what would it be bridged?
        symptomatic_ |= bit(c);
      }
      without_ |= bit(c);
      believed_[c] = predicted;
    }
  }

  /// Also what would make numbers overflow later is none.
  static bool number(Real raw) { return std::fabs(raw) < kNoNumber; }

  bool late(int c) const { return late_ && c >= n && late_->is(c - n); }
  int every(int c) const { return late(c) ? std::max(1, late_->settings.every[c - n]) : 1; }

  Symptom symptom_of(int c) const {
    const MonitoredReading& reading = watch_.reading[c];
    const Real raw = q_e_[c], low = settings_.low[c], high = settings_.high[c];
    if (!number(raw)) return Symptom::missing;
    if (low < high && !(raw >= low && raw <= high)) return Symptom::out_of_range;
    const bool followed = watch_.cycle - watch_.began > kFollowed;
    if (!followed || watch_.undecided || !(settings_.fastest[c] > 0)) return Symptom::none;
    // While nothing is read the way adds up: after m cycles another m(m + 3)/2 of an acceleration.
    // One that has jumped must come back to where it would be.
    const int m = reading.symptom == Symptom::missing ? reading.bridged : 0;
    const Real way = settings_.period * settings_.period * settings_.fastest[c] *
                     (settings_.own.acceleration + 0.5 * m * (m + 3));
    const Real chance = settings_.sigmas * std::sqrt(settings_.own.variance * noise_[c]) * (1 + m);
    return std::fabs(innovation_[c]) > way + chance ? Symptom::too_fast : Symptom::none;
  }

  Outcome place() {
    Pose near = moved<K>(watch_.pose, watch_.motion);
    if (!watch_.placed) {
      near = to_pose<K>(robot_.home);
      const Outcome found{fkm<K>(robot_, motors_of<K>(believed_), near).status, -1};
      if (!found) return found;
    }
    return parity_.place(robot_, near, believed_, watch_.beyond);
  }

  /// A reading's error is taken as unknown: by as much as hides it in every equation.
  void leave_out(int c) {
    const Reading g = parity_.signature(r_, c);
    Real size = 0, known = 0;
    for (int k = 0; k < r_; ++k) {
      size += g[k] * g[k];
      known += noise_[n + k] + watch_.geometry[k][k];
      for (int j = 0; j < n; ++j) known += parity_.g[k][j] * parity_.g[k][j] * noise_[j];
    }
    if (!(size > 0 && known > 0)) return;
    unknown_[c] = kUnknown * known / size;
    ++left_out_;
  }

  /// @param gain  of the readings' own variances @param share  of the geometry's
  bool covariance(Real gain, Real share, ReadingCovariance& V) const {
    Extended variance{};
    for (int c = 0; c < rows_; ++c) variance[c] = gain * noise_[c] + unknown_[c];
    parity_.covariance(r_, variance, watch_.geometry, watch_.known ? share : 0, V);
    return V.factor(r_);
  }

  /// What of the geometry's error bends on the way, as a share of all of it: its σ in the parity
  /// tracker's innovation. The error is a function of the pose, so an acceleration moves it as far
  /// as the pose, a velocity by its square.
  Real bending() const {
    Real way2 = 0, bend2 = 0;
    for (int i = 0; i < n; ++i) {
      const Real bend = watch_.motion[i] - watch_.last[i];
      way2 += watch_.motion[i] * watch_.motion[i];
      bend2 += bend * bend;
    }
    const Real per = 1 / settings_.correlation;
    return settings_.together.acceleration * per * (std::sqrt(bend2) + way2 * per);
  }

  /// All readings together: level and change of the parity.
  void together() {
    Reading change{};
    for (int k = 0; k < r_; ++k)
      change[k] = parity_.value[k] - watch_.parity[k].predicted(settings_.period);
    Verdict changed, level;
    ReadingCovariance V;
    // While something is doubted the tracker only predicts, for some cycles.
    const Real coasted = 1 + 0.5 * watch_.disagreed * (1 - kParityPole);
    const Real bend = bending() * coasted * coasted;
    if (!watch_.undecided && covariance(settings_.together.variance, bend * bend, V))
      changed = judge<K>(parity_, settings_.chi2, V, change, r_, without_, left_out_);
    if (watch_.known && covariance(1, 1, V)) {
      level = judge<K>(parity_, settings_.chi2, V, parity_.value, r_, without_, left_out_);
      watch_.chi2 = level.chi2;
      watch_.freedom = level.freedom;
    }
    if (!changed.alarm && !level.alarm) {
      watch_.disagreed = std::max(0, watch_.disagreed - 1);
      if (!watch_.undecided) watch_.doubted = 0;
      return;
    }
    name(changed, level);
    if (watch_.doubted & (watch_.doubted - 1)) {  // several
      // A drift is beyond its limit now and then, then always.
      if (!watch_.undecided) watch_.disagreed += 2;
      watch_.undecided = watch_.undecided || watch_.disagreed > 2 * settings_.decide;
      // Until it is known which, sensors say what they would if nothing had changed, and a motor
      // that stands still goes where it is asked to go: its encoder may drive it away meanwhile.
      for (int k = 0; k < r_; ++k) believed_[n + k] -= change[k];
      for (int c = 0; c < n && !watch_.undecided; ++c)
        if (watch_.doubted & bit(c) & ~without_ && watch_.reading[c].still >= kStill) {
          held_ |= bit(c);
          if (std::isfinite(desired_[c])) believed_[c] = desired_[c] - watch_.reading[c].behind;
        }
      return;
    }
    watch_.disagreed = 0;
    for (int c = 0; c < rows_; ++c) {
      if (!(watch_.doubted & bit(c))) continue;
      bridge(settings_, watch_.cycle, Symptom::disagrees, every(c), watch_.reading[c]);
      symptomatic_ |= bit(c);
      without_ |= bit(c);
      leave_out(c);
    }
    watch_.doubted = 0;
  }

  /// Which readings may alone be wrong, as far as is known by now.
  void name(const Verdict& changed, const Verdict& level) {
    if (watch_.undecided) return;  // a robot that is being stopped is another one
    const std::uint32_t first = changed.alarm ? changed.may : ~0U;
    const std::uint32_t second = level.alarm ? level.may : ~0U;
    std::uint32_t may = first & second ? first & second : first | second;
    may &= bit(rows_) - 1;
    const auto alone = [](std::uint32_t set) { return set && !(set & (set - 1)); };
    std::uint32_t still = 0, apart = 0;
    for (int c = 0; c < rows_; ++c) {
      if (without_ & bit(c)) continue;
      if (raw(c) == watch_.reading[c].raw && stood(c) > much(c, kStoodBy)) still |= bit(c);
      if (leaves_track(c, innovation_[c]) && !motor_left(c)) apart |= bit(c);
    }
    if (alone(may & still)) {
      may &= still;
    } else if (changed.alarm && alone(apart) && may & apart) {
      for (int c = 0; c < rows_; ++c)
        if (apart & bit(c) && !leaves_track(c, innovation_[c] - changed.by[c])) may = apart;
    }
    const std::uint32_t both = watch_.doubted & may;
    watch_.doubted = both ? both : may;
  }

  /// Cycles after which a reading stands still.
  static constexpr int kStill = 3;
  /// Share of `moved` from which on a reading that stands still beside an alarm is the one.
  static constexpr Real kStoodBy = 0.4;
  /// σ by which a motor may be beside where it usually is beside its setpoint.
  static constexpr Real kStrays = 8;

  bool leaves_track(int c, Real innovation) const {
    const Real spread = settings_.own.variance * noise_[c] + watch_.reading[c].spread;
    return innovation * innovation > settings_.sigmas * settings_.sigmas * spread;
  }

  /// What a motor has lost since a late sample was taken shows when that arrives: whether it may.
  bool motor_left(int c) const {
    bool any = false;
    for (int i = 0; late(c) && i < n; ++i)
      any =
          any || watch_.cycle - watch_.reading[i].left <= 1 + every(c) + late_->settings.age[c - n];
    return any;
  }

  Real model(int c) const {
    if (late(c)) return late_->then[c - n];
    // Where the motors say that the robot is: `expected` is of the pose from which that was found.
    return c < n ? desired_[c] : parity_.read[c] - parity_.value[c - n];
  }

  /// What tells whether a reading stands still, and beside which model: a late one's last sample.
  Real raw(int c) const { return late(c) ? late_->sample[c - n] : q_e_[c]; }

  /// A motor whose encoder stands still is driven by an error that only seems, δ = q_d less what it
  /// was when the reading changed last: it leaves its setpoint by ∬ kp δ + kd dδ/dt. An error at
  /// which a healthy motor may rest drives nothing, and lets it come to rest.
  void drive(int c) const {
    MonitoredReading& reading = watch_.reading[c];
    const Real away = desired_[c] - reading.model;
    const Real bears = settings_.rests[c];
    const Real seems = away > bears ? away - bears : away < -bears ? away + bears : 0;
    reading.speed +=
        settings_.period * settings_.kp[c] * seems + settings_.kd[c] * (seems - reading.seems);
    if (seems == 0) reading.speed = 0;
    reading.seems = seems;
    reading.way += settings_.period * reading.speed;
  }

  /// Motion of the model beside a reading that stands still which is too much. A motor that swings
  /// about its path, as where a sensor is late by which a law leads it, stands still where it
  /// turns, while its setpoint passes: it is judged by what it follows its setpoint to.
  Real much(int c, Real share) const {
    const MonitoredReading& reading = watch_.reading[c];
    return std::max(share * settings_.moved[c], kStrays * std::sqrt(reading.strays));
  }

  /// By how much the model has moved since the reading changed last, beyond what is noise; and by
  /// how much away from the motor, not towards it.
  Real stood(int c) const {
    const MonitoredReading& reading = watch_.reading[c];
    const Real by = model(c) - reading.model + reading.way;
    return std::min(std::fabs(by), std::fabs(by + reading.off)) -
           settings_.sigmas * parity_.expectation_noise(noise_, c);
  }

  /// By how much a motor is behind, and how that varies while it is seen to move.
  void trail(int c) const {
    MonitoredReading& reading = watch_.reading[c];
    reading.behind = desired_[c] - believed_[c];
    const Real off = reading.behind - reading.usual;
    if (reading.still > 0 || !number(off)) return;
    reading.off = off;
    reading.usual += off / kSettling;
    reading.strays += (off * off - reading.strays) / kSettling;
  }

  /// What stands for the readings that are not believed: their errors unknown, b̂ = Σ_b GᵀV⁻¹ p.
  void replace() {
    ReadingCovariance V, own;
    const bool regular = r_ > 0 && covariance(1, 1, V);
    if (regular) parity_.covariance(r_, noise_, watch_.geometry, 0, own);
    Reading y = parity_.value;
    if (regular) V.whiten(r_, y.data(), 1);
    Coordinates step{};
    for (int c = 0; c < rows_; ++c) {
      if (!(without_ & bit(c))) continue;
      if (watch_.reading[c].health != Health::failed) {
        // Bridged: a sensor goes where the motors go, a motor where it is asked to go.
        believed_[c] = watch_.reading[c].own.predicted(settings_.period);
        if (c < n && std::isfinite(desired_[c]))
          believed_[c] = desired_[c] - watch_.reading[c].behind;
        if (c >= n && (late(c) || !(without_ & (bit(n) - 1))))
          believed_[c] = parity_.read[c] - parity_.value[c - n] +
                         watch_.parity[c - n].predicted(settings_.period);
        continue;
      }
      Reading g = parity_.signature(r_, c);
      Real score = 0, information = 0;
      if (regular) V.whiten(r_, g.data(), 1);
      for (int k = 0; k < r_ && regular; ++k) {
        score += g[k] * y[k];
        information += g[k] * g[k];
      }
      const Real left = unknown_[c] * (1 - unknown_[c] * information);  // variance of b̂
      const bool good = regular && unknown_[c] > 0 && left < 0.5 * unknown_[c];
      const Real b = unknown_[c] * score;
      // A motor that is lost stays so: by now its brake closes.
      const bool lost = watch_.lost & bit(c);
      if (good && number(b) && !lost && (c >= n || replaceable(c, left, g, V, own))) {
        believed_[c] -= b;
        if (c < n)
          for (int i = 0; i < n; ++i) step[i] -= parity_.jacobians.J[i][c] * b;
      } else if (c < n) {
        watch_.lost |= bit(c);
        believed_[c] = desired_[c];  // nothing is asked of the motor
      } else {
        believed_[c] = parity_.read[c] - parity_.value[c - n];  // as far as the motors can say
      }
    }
    parity_.pose = moved<K>(parity_.pose, step);
  }

  /// Whether b̂ is good enough to drive a motor by: σ² in all, and that of the part which is new in
  /// every cycle, Σ_b² gᵀV⁻¹ V_s V⁻¹g of the readings' own errors; the velocity loop shakes by it.
  /// @param left  variance of b̂ @param g  of the reading, whitened by V @param own  V_s
  bool replaceable(int c, Real left, Reading g, const ReadingCovariance& V,
                   const ReadingCovariance& own) const {
    if (!(left < settings_.replaceable * settings_.replaceable)) return false;
    const Real most = settings_.shaken[c];
    if (!(most > 0)) return true;
    V.colour(r_, g.data());
    Real sum = 0;
    for (int k = 0; k < r_; ++k)
      for (int l = 0; l < r_; ++l) sum += g[k] * own.L[std::max(k, l)][std::min(k, l)] * g[l];
    return unknown_[c] * unknown_[c] * sum < most * most;
  }

  /// Every reading's next value. @return the first that is not valid, or -1
  int follow() {
    int first = -1;
    std::uint32_t without = 0;
    bool motors = watch_.placed;  // whether they say where the robot is
    for (int c = 0; c < n; ++c) motors = motors && watch_.reading[c].health != Health::failed;
    for (int c = 0; c < rows_; ++c) {
      MonitoredReading& reading = watch_.reading[c];
      // With a motor lost the robot does not do what it is asked to. One that stops since nobody
      // knows which reading is faulty does: it may still be isolated.
      const bool judged = (!watch_.doubted || (watch_.undecided && c < n)) && !symptomatic_ &&
                          !watch_.lost && settings_.moved[c] > 0 && (c < n || motors);
      // What is asked is only known from the second cycle on.
      if (raw(c) != reading.raw || watch_.cycle - watch_.began < 2) {
        reading.raw = raw(c);
        if (c < n || watch_.placed) reading.model = model(c);
        reading.seems = reading.speed = reading.way = 0;
        reading.still = 0;
      } else {
        if (reading.still < kStill) ++reading.still;  // a robot may stand still for months
        if (c < n) drive(c);
        if (judged && reading.health != Health::failed &&
            stood(c) > much(c, watch_.undecided ? 3 : 1)) {
          reading.health = Health::failed;
          reading.symptom = Symptom::stuck;
        }
      }
      const bool believed = !(without_ & bit(c));
      Real news = innovation_[c];  // what is not believed follows what stands for it
      if (!believed) news = believed_[c] - reading.own.predicted(settings_.period);
      if (believed) {
        if (reading.health == Health::suspect) reading.health = Health::valid;
        reading.bridged = 0;
        if (c < n) trail(c);
        reading.spread += (innovation_[c] * innovation_[c] - reading.spread) / kSettling;
      }
      reading.own.correct(settings_.period, kOwnPole, number(news) ? news : 0);
      if (watch_.doubted & bit(c) && reading.health == Health::valid)
        reading.health = Health::suspect;
      if (!believed && reading.health == Health::failed) without |= bit(c);
      if (first < 0 && reading.health != Health::valid) first = c;
    }
    for (int k = 0; k < r_ && watch_.placed; ++k) {
      Tracker& parity = watch_.parity[k];
      const Real change = parity_.value[k] - parity.predicted(settings_.period);
      if (watch_.cycle == watch_.began) parity = {parity_.value[k], 0};
      const bool holds = watch_.doubted || symptomatic_;  // what may be wrong teaches nothing
      parity.correct(settings_.period, kParityPole, holds || !number(change) ? 0 : change);
      if (holds) parity.rate *= kParityPole;
    }
    watch_.changed = watch_.without != without || (watch_.held & ~held_) != 0;
    watch_.without = without;
    watch_.held = held_;
    return first;
  }

  /// Whether what is known of the geometry is of another pose, or an older learner's.
  bool stale() {
    for (int i = 0; i < n; ++i) watch_.way += std::fabs(watch_.motion[i]);
    const bool far = watch_.way > kSamePlace * settings_.correlation;
    if (!far && watch_.cycle % settings_.refresh != 0) return false;
    watch_.way = 0;
    return true;
  }

  /// What the geometry leaves open, and what the full level adds, at the pose of the moment.
  TRUEPOSE_APART Outcome refresh() {
    const Knowledge& known = *weighing_.known;
    Real *H_xi = weighing_.work, *B = H_xi + rows_ * parameter_count(robot_);
    Extended q_e, beyond{};
    Matrix<kMaxReadings, n> H_x;
    Outcome outcome;
    if (robot_.rod_by_rod()) {
      Parasitic rest;
      outcome = FullModel::linearise<K>(robot_, watch_.pose, q_e, H_x, H_xi, rest);
      Extended ideal;
      if (outcome) outcome = extended<K>(robot_, watch_.pose, ideal);
      for (int c = 0; c < rows_ && outcome; ++c) beyond[c] = q_e[c] - ideal[c];
    } else {
      outcome = linearise<K>(robot_, watch_.pose, q_e, H_x, H_xi);
    }
    if (!outcome) return outcome;
    parity_.open(robot_, known, H_xi, B);
    for (int k = 0; k < r_; ++k)
      for (int l = 0; l <= k; ++l)
        watch_.geometry[k][l] = dot(known.count, B + k * known.count, B + l * known.count);
    for (int k = 0; k < r_; ++k) {  // the parity's tracker must not take it for a change,
      Real more = beyond[n + k] - watch_.beyond[n + k];
      for (int j = 0; j < n; ++j) more -= parity_.g[k][j] * (beyond[j] - watch_.beyond[j]);
      if (!number(more)) continue;
      watch_.parity[k].value -= more;
      watch_.reading[n + k].model += more;  // nor for a motion beside a sensor that stands still
    }
    watch_.beyond = beyond;
    return {};
  }

  const Robot& robot_;
  const FaultMonitorSettings& settings_;
  const Weighing& weighing_;
  const Joint& desired_;
  Extended q_e_;  ///< as read; late ones as of now
  FaultMonitor& watch_;
  Extended& believed_;
  Multirate* late_;  ///< sensors that are slow or late; nullptr: none
  int r_, rows_;
  bool settled_;
  Parity<K> parity_;
  Extended noise_{};               ///< variances of the readings' own errors
  Extended unknown_{};             ///< of errors of which nothing is known
  int left_out_ = 0;               ///< how many
  Extended innovation_{};          ///< of each reading's own tracker
  std::uint32_t symptomatic_ = 0;  ///< that are bridged
  std::uint32_t without_ = 0;      ///< that are not believed
  std::uint32_t held_ = 0;         ///< motors that are doubted, and go where they are asked to go
};

}  // namespace watch_detail

/// One cycle.
///
/// @param weighing  what is known of the geometry and of the readings' own errors; work space
/// @param desired   q_d: what a motor that stands still is measured by
/// @param believed  out: the readings, or what stands for those that are not believed
/// @param late      in and out: of slow and late sensors, which are brought up; nullptr: none
/// @return `disagree` and the first reading that is not valid; no answer: no pose can be made of
/// the readings
template <Mobility K>
Outcome monitor_faults(const Robot& robot, const FaultMonitorSettings& settings,
                       const Weighing& weighing, const Joint& desired, const Extended& q_e,
                       FaultMonitor& watch, Extended& believed, Multirate* late = nullptr) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (!weighing) return {Status::not_measured, -1};
  return watch_detail::Cycle<K>(robot, settings, weighing, desired, q_e, watch, believed, late)
      .run();
}

}  // namespace truepose
