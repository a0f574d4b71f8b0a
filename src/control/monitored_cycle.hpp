// One cycle of the fault monitor: its readings, tests of them, and the geometry's part of the
// parity.
#pragma once

#include "control/fault_monitor_state.hpp"
#include "control/multirate.hpp"
#include "control/parity.hpp"

namespace truepose::fault_monitor_detail {
/// Inputs, intermediate results and tests of one cycle.
struct MonitoredCycle {
  const Robot& robot_;
  const FaultMonitorSettings& settings_;
  const Weighing& weighing_;
  const Joint& desired_;
  Extended q_e_;  ///< readings; delayed ones extrapolated to now
  FaultMonitor& monitor_;
  Extended& believed_;
  Multirate* late_;  ///< slow and delayed sensors; nullptr: none

  const int n = dof(robot_.mobility), r_ = robot_.r, rows_ = n + r_;
  bool settled_ = monitor_.cycle - monitor_.began > kSettling;
  Parity parity_;
  Extended noise_{};               ///< variances of the readings' own errors
  Extended unknown_{};             ///< of unknown errors
  int left_out_ = 0;               ///< their number
  Extended innovation_{};          ///< of each reading's own tracker
  std::uint32_t symptomatic_ = 0;  ///< extrapolated readings,
  std::uint32_t standing_ = 0;     ///< those of them that stand still
  std::uint32_t wild_ = 0;         ///< readings that jump as no noise does
  std::uint32_t still_ = 0;        ///< isolated by standing still
  std::uint32_t without_ = 0;      ///< excluded readings,
  std::uint32_t replaced_ = 0;     ///< those of them that the others give
  std::uint32_t held_ = 0;         ///< candidate motors held at their setpoints

  // Not an aggregate: that would be filled with zeros first.
  MonitoredCycle(const Robot& robot, const FaultMonitorSettings& settings, const Weighing& weighing,
                 const Joint& desired, const Extended& q_e, FaultMonitor& monitor,
                 Extended& believed, Multirate* late)
      : robot_(robot),
        settings_(settings),
        weighing_(weighing),
        desired_(desired),
        q_e_(q_e),
        monitor_(monitor),
        believed_(believed),
        late_(late) {
    for (int c = 0; c < rows_; ++c) noise_[c] = variance(c);
  }

  /// Variance of a reading's own error.
  Real variance(int c) const {
    const Real sigma = weighing_.known->sigma[c];
    return sigma * sigma + monitor_.reading[c].noise.variance();
  }

  /// False also where later numbers would overflow.
  static bool number(Real raw) { return std::fabs(raw) < kNoNumber; }

  bool late(int c) const { return late_ && c >= n && late_->is(c - n); }
  int every(int c) const { return late(c) ? std::max(1, late_->settings.every[c - n]) : 1; }

  /// Whether no motor's reading has failed.
  bool motors_valid() const {
    return std::none_of(monitor_.reading.begin(), monitor_.reading.begin() + n,
                        [](const auto& motor) { return motor.health == Health::failed; });
  }

  Symptom symptom_of(int c) const {
    const MonitoredReading& reading = monitor_.reading[c];
    const Real raw = q_e_[c], low = settings_.low[c], high = settings_.high[c];
    if (!number(raw)) return Symptom::missing;
    if (low < high && !(raw >= low && raw <= high)) return Symptom::out_of_range;
    if (reading.stands && this->raw(c) == reading.raw) return Symptom::stuck;
    if (wild_ & bit(c)) return Symptom::too_fast;
    if (monitor_.undecided || !followed(c)) return Symptom::none;
    const Real chance = settings_.sigmas * std::sqrt(settings_.own.variance * noise_[c]);
    return off_track(c) > chance * (1 + missed(c)) ? Symptom::too_fast : Symptom::none;
  }

  /// Whether a reading's track and the limit of its acceleration are known.
  bool followed(int c) const {
    return monitor_.cycle - monitor_.began > kFollowed && settings_.fastest[c] > 0;
  }

  /// Cycles without a reading before this one. One that jumped must return to its prediction.
  int missed(int c) const {
    const MonitoredReading& reading = monitor_.reading[c];
    const bool gap = reading.symptom == Symptom::missing || reading.symptom == Symptom::stuck;
    return gap ? reading.bridged : 0;
  }

  /// Deviation from a reading's prediction beyond what the largest acceleration explains.
  Real off_track(int c) const {
    // With pole p the tracker, extrapolated over m missing cycles, lags by another m(1 + p)/(1 - p)
    // + m(m + 1)/2 of an acceleration.
    const int m = missed(c);
    const Real lag = m * ((1 + kOwnPole) / (1 - kOwnPole) + 0.5 * (m + 1));
    const Real way = settings_.period * settings_.period * settings_.fastest[c] *
                     (settings_.own.acceleration + lag);
    return std::fabs(innovation_[c]) - way;
  }

  /// Whether a reading jumps farther than noise that may be smoothed: off its track, and off the
  /// model's motion since it changed last, by which a held reading jumps.
  bool wild(int c) const {
    if (!(std::fabs(innovation_[c]) > settings_.wild[c]) || late(c) || !followed(c)) return false;
    const MonitoredReading& reading = monitor_.reading[c];
    const Real by = c < n ? desired_[c] - reading.model : reading.told;
    const Real jump = std::fabs(within_turn(robot_, c, q_e_[c] - reading.raw - by));
    const Real chance = settings_.sigmas * weighing_.known->sigma[c];
    const Real most = std::max(settings_.wild[c], chance * std::sqrt(settings_.own.variance));
    return !(std::min(off_track(c), jump) <= most * (1 + missed(c)));
  }

  /// Factors V. @param gain  on the readings' own variances @param share  on the geometry's
  bool covariance(Real gain, Real share, ReadingCovariance& V) const {
    Extended variance;
    for (int c = 0; c < rows_; ++c) variance[c] = gain * noise_[c] + unknown_[c];
    parity_.covariance(r_, variance, monitor_.geometry, monitor_.known ? share : 0, V);
    return V.factor(r_);
  }

  /// σ of the geometry's error in the parity tracker's innovation, as a share of the whole error.
  /// That error is a function of the pose: an acceleration changes it as far as the pose, a
  /// velocity by its square.
  Real bending() const {
    Real way2 = 0, bend2 = 0;
    for (int i = 0; i < n; ++i) {
      const Real bend = monitor_.motion[i] - monitor_.last[i];
      way2 += monitor_.motion[i] * monitor_.motion[i];
      bend2 += bend * bend;
    }
    const Real per = 1 / settings_.correlation;
    return settings_.together.acceleration * per * (std::sqrt(bend2) + way2 * per);
  }

  static constexpr int kLongest = 1000;  ///< cycles, counted at most
  /// Share of `moved` above which a reading that stands still during an alarm is isolated, or one
  /// whose motor was driven off.
  static constexpr Real kStoodBy = 0.4;
  /// Share of `moved` by which asked() must have left a reading that stands still.
  static constexpr Real kAsked = 0.2;
  /// σ by which a motor may deviate from its usual following error.
  static constexpr Real kStrays = 8;
  /// Interval and grain of a held reading beyond which it stands still.
  static constexpr Real kLonger = 1.5;

  bool leaves_track(int c, Real innovation) const {
    const Real spread = settings_.own.variance * noise_[c] + monitor_.reading[c].spread;
    return innovation * innovation > settings_.sigmas * settings_.sigmas * spread;
  }

  /// Whether a motor left its track since a delayed sample was taken, which shows it only now.
  bool motor_left(int c) const {
    bool any = false;
    for (int i = 0; late(c) && i < n; ++i)
      any = any || monitor_.cycle - monitor_.reading[i].left <= 1 + every(c) + late_->age[c - n];
    return any;
  }

  Real model(int c) const {
    if (late(c)) return late_->then[c - n];
    // At the motors' pose; `expected` is at the pose from which that was found.
    return c < n ? desired_[c] : parity_.read[c] - parity_.value[c - n];
  }

  /// Value whose changes show that a reading moves: of a delayed sensor its last sample.
  Real raw(int c) const { return late(c) ? late_->sample[c - n] : q_e_[c]; }

  /// Largest model motion while a reading stands still. A motor that oscillates about its path, for
  /// example by a law with a delayed sensor, stands still at its turning points while its setpoint
  /// moves on: its usual deviation counts.
  Real much(int c, Real share) const {
    const MonitoredReading& reading = monitor_.reading[c];
    return std::max(share * settings_.moved[c], kStrays * std::sqrt(reading.strays)) +
           kLonger * reading.noise.grain + 2 * reading.pushed;
  }

  /// Whether a reading stands still for longer than between its samples. An error that friction
  /// cannot hold must have driven a motor off its count, unless it was held at its setpoint.
  bool stands(int c, Real share) const {
    const MonitoredReading& reading = monitor_.reading[c];
    return reading.still > kLonger * reading.noise.interval &&
           (stood(c, reading.way) > much(c, share) ||
            (!monitor_.undecided && std::fabs(reading.way) > much(c, kStoodBy)));
  }

  /// Model minus smoothed reading. @param deviation  model minus reading
  Real smooth(int c, Real deviation) {
    ReadingNoise& noise = monitor_.reading[c].noise;
    if (!number(deviation)) return deviation;
    constexpr Real kAssumed = 1000;  // rad/s² or m/s², where a motor's limit is unknown
    const Real fastest = settings_.fastest[c] > 0 ? settings_.fastest[c] : kAssumed;
    const bool fresh = raw(c) != monitor_.reading[c].raw, motor = c < n;
    const Real off = noise.smooth(settings_.period, deviation, fresh, weighing_.known->sigma[c],
                                  kUnmodelled * fastest, motor ? settings_.kp[c] : 0,
                                  motor ? settings_.kd[c] : 0);
    if (number(off) && number(noise.off.rate)) return off;
    noise.off = {deviation, 0};  // gains too high for the period
    return deviation;
  }

  /// Value to which a reading is led: a motor's by its drive, a sensor's by q_d, linear from the
  /// motors' pose.
  Real asked(int c) const {
    if (c < n) return desired_[c] + monitor_.led[c];
    Real value = parity_.expected[c];
    for (int j = 0; j < n; ++j) value += parity_.g[c - n][j] * (desired_[j] - parity_.expected[j]);
    return number(value) ? value : monitor_.reading[c].asked;
  }

  /// Motion of the setpoint in this cycle, as a sensor would read it.
  Real told(int sensor) const {
    Real sum = 0;
    for (int j = 0; j < n; ++j)
      sum += parity_.g[sensor - n][j] * (desired_[j] - monitor_.desired[j]);
    return number(sum) ? sum : 0;
  }

  /// Model motion beyond noise since the reading changed last: of a motor the smaller of that and
  /// of its distance from it, so that motion towards it does not count. A law that holds a platform
  /// moves its motors where one of them drifts, and the sensor stands at its setpoint; where a
  /// sensor is wrong, a motor that the law leads against its setpoint turns back. Motion therefore
  /// counts once asked() has left the reading that way by kAsked of `moved`.
  /// @param way  by which its loop has driven the motor off
  Real stood(int c, Real way) const {
    const MonitoredReading& reading = monitor_.reading[c];
    const Real by = model(c) - reading.model + way;
    const Real also = c < n ? by + reading.off : by, side = std::copysign(Real(1), by);
    Real left = side * (asked(c) - reading.asked + way);
    // Off q_d both are approximate: one far from it, the other along a long way.
    if (c >= n) left = std::min(left, side * reading.told);
    if (!(left > kAsked * settings_.moved[c])) return 0;
    return std::min(std::fabs(by), std::fabs(also)) -
           settings_.sigmas * parity_.expectation_noise(noise_, c);
  }

  /// Whether b̂ may drive a motor: its σ², and its variance from the readings' own errors, Σ_b²
  /// gᵀV⁻¹ V_s V⁻¹g, which is new in every cycle and shakes the velocity loop.
  /// @param left  variance of b̂ @param g  signature of the reading, whitened by V @param own  V_s
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

  /// Whether the geometry's covariance is of another pose or, with online calibration, outdated.
  bool stale() {
    for (int i = 0; i < n; ++i) monitor_.way += std::fabs(monitor_.motion[i]);
    const bool far = monitor_.way > kSamePlace * settings_.correlation;
    if (!far && monitor_.cycle % settings_.refresh != 0) return false;
    monitor_.way = 0;
    return true;
  }

  /// Follows a warm-up. @param cold  parity of the geometry without growth
  /// @return the growths' part of it
  Reading warm(const Real* H_xi, const Reading& cold) {
    if constexpr (!kFollowsWarmUp) return {};
    WarmUp& warm_up = monitor_.warm_up;
    const Growths& growth = settings_.growth;
    if (std::none_of(growth.begin(), growth.end(), [](Real most) { return most > 0; })) return {};
    const GrowthRows M = growth_rows(robot_, parity_, H_xi, growth);
    const Real since = settings_.period * static_cast<Real>(monitor_.cycle - monitor_.updated);
    monitor_.updated = monitor_.cycle;
    ReadingCovariance V;
    const auto alarm = [&] {
      return parity_verdict(parity_, settings_.chi2, V, cold, r_, without_, left_out_).alarm;
    };
    auto total = monitor_.geometry;
    for (int k = 0; k < r_; ++k)
      for (int l = 0; l <= k; ++l)
        for (int m = 0; m < kGrowths; ++m) total[k][l] += M[k][m] * M[l][m];
    std::swap(total, monitor_.geometry);
    warm_up.warm = false;
    if (!covariance(1, 1, V) || alarm()) return {};  // growth alone does not explain it
    std::swap(total, monitor_.geometry);
    if (!covariance(1, 1, V) || !all_finite(cold, r_)) return {};
    warm_up.warm = alarm();
    if (!monitor_.doubted && !symptomatic_)
      warm_up.average(M, V, cold, r_, since, settings_.memory);
    return warm_up.explain(M, r_, monitor_.geometry);
  }

  /// Updates the geometry's covariance and the full level's addition at the present pose.
  void refresh() {
    const Knowledge& known = *weighing_.known;
    Real *H_xi = weighing_.work, *B = H_xi + rows_ * parameter_count(robot_);
    Extended q_e, beyond{};
    PoseRows H_x;
    Outcome outcome;
    if (robot_.rod_by_rod()) {
      Extended ideal;
      outcome = linearise_full(robot_, monitor_.pose, q_e, H_x, H_xi);
      if (outcome) outcome = extended(robot_, monitor_.pose, ideal);
      for (int c = 0; c < rows_ && outcome; ++c) beyond[c] = q_e[c] - ideal[c];
    } else {
      outcome = linearise(robot_, monitor_.pose, q_e, H_x, H_xi);
    }
    monitor_.known = bool(outcome);
    if (!outcome) return;
    parity_.open(robot_, known, H_xi, B);
    for (int k = 0; k < r_; ++k)
      for (int l = 0; l <= k; ++l)
        monitor_.geometry[k][l] = dot(known.count, B + k * known.count, B + l * known.count);
    Reading more, cold{};
    for (int k = 0; k < r_; ++k) {
      more[k] = beyond[n + k] - monitor_.beyond[n + k];
      for (int j = 0; j < n; ++j) more[k] -= parity_.g[k][j] * (beyond[j] - monitor_.beyond[j]);
      cold[k] = parity_.value[k] - more[k];
    }
    const Reading grown = warm(H_xi, cold);
    for (int k = 0; k < r_; ++k) {  // the parity's tracker must not see a change,
      if (number(grown[k])) beyond[n + k] += grown[k];
      more[k] += grown[k];
      if (!number(more[k])) continue;
      monitor_.parity[k].value -= more[k];
      monitor_.usual[k] -= more[k];
      monitor_.reading[n + k].model += more[k];  // nor a sensor that stands still a motion
      monitor_.reading[n + k].asked += more[k];
    }
    monitor_.beyond = beyond;
  }
};
}  // namespace truepose::fault_monitor_detail
