// One cycle of the fault monitor: its readings, tests of them, and the geometry's part of the
// parity.
#include "control/monitored_cycle.hpp"

namespace truepose::fault_monitor_detail {
MonitoredCycle::MonitoredCycle(const Robot& robot, const FaultMonitorSettings& settings,
                               const Weighing& weighing, const Joint& desired, const Extended& q_e,
                               FaultMonitor& monitor, Extended& believed, Multirate* late)
    : robot_(robot),
      settings_(settings),
      weighing_(weighing),
      desired_(desired),
      q_e_(q_e),
      monitor_(monitor),
      believed_(believed),
      late_(late) {
  for (int c = 0; c < rows_; ++c) noise_[c] = weighing_.known->sigma[c] * weighing_.known->sigma[c];
}

bool MonitoredCycle::motors_valid() const {
  return std::none_of(monitor_.reading.begin(), monitor_.reading.begin() + n,
                      [](const auto& motor) { return motor.health == Health::failed; });
}

Symptom MonitoredCycle::symptom_of(int c) const {
  const MonitoredReading& reading = monitor_.reading[c];
  const Real raw = q_e_[c], low = settings_.low[c], high = settings_.high[c];
  if (!number(raw)) return Symptom::missing;
  if (low < high && !(raw >= low && raw <= high)) return Symptom::out_of_range;
  if (reading.stands && this->raw(c) == reading.raw) return Symptom::stuck;
  if (monitor_.undecided || !followed(c)) return Symptom::none;
  const Real chance = settings_.sigmas * std::sqrt(settings_.own.variance * noise_[c]);
  return off_track(c) > chance * (1 + missed(c)) ? Symptom::too_fast : Symptom::none;
}

bool MonitoredCycle::followed(int c) const {
  return monitor_.cycle - monitor_.began > kFollowed && settings_.fastest[c] > 0;
}

int MonitoredCycle::missed(int c) const {
  const MonitoredReading& reading = monitor_.reading[c];
  const bool gap = reading.symptom == Symptom::missing || reading.symptom == Symptom::stuck;
  return gap ? reading.bridged : 0;
}

Real MonitoredCycle::off_track(int c) const {
  // With pole p the tracker, extrapolated over m missing cycles, lags by another m(1 + p)/(1 - p)
  // + m(m + 1)/2 of an acceleration.
  const int m = missed(c);
  const Real lag = m * ((1 + kOwnPole) / (1 - kOwnPole) + 0.5 * (m + 1));
  const Real way = settings_.period * settings_.period * settings_.fastest[c] *
                   (settings_.own.acceleration + lag);
  return std::fabs(innovation_[c]) - way;
}

bool MonitoredCycle::covariance(Real gain, Real share, ReadingCovariance& V) const {
  Extended variance;
  for (int c = 0; c < rows_; ++c) variance[c] = gain * noise_[c] + unknown_[c];
  parity_.covariance(r_, variance, monitor_.geometry, monitor_.known ? share : 0, V);
  return V.factor(r_);
}

Real MonitoredCycle::bending() const {
  Real way2 = 0, bend2 = 0;
  for (int i = 0; i < dof(robot_.mobility); ++i) {
    const Real bend = monitor_.motion[i] - monitor_.last[i];
    way2 += monitor_.motion[i] * monitor_.motion[i];
    bend2 += bend * bend;
  }
  const Real per = 1 / settings_.correlation;
  return settings_.together.acceleration * per * (std::sqrt(bend2) + way2 * per);
}

bool MonitoredCycle::leaves_track(int c, Real innovation) const {
  const Real spread = settings_.own.variance * noise_[c] + monitor_.reading[c].spread;
  return innovation * innovation > settings_.sigmas * settings_.sigmas * spread;
}

bool MonitoredCycle::motor_left(int c) const {
  bool any = false;
  for (int i = 0; late(c) && i < n; ++i)
    any = any || monitor_.cycle - monitor_.reading[i].left <= 1 + every(c) + late_->age[c - n];
  return any;
}

Real MonitoredCycle::model(int c) const {
  if (late(c)) return late_->then[c - n];
  // At the motors' pose; `expected` is at the pose from which that was found.
  return c < n ? desired_[c] : parity_.read[c] - parity_.value[c - n];
}

Real MonitoredCycle::much(int c, Real share) const {
  const MonitoredReading& reading = monitor_.reading[c];
  return std::max(share * settings_.moved[c], kStrays * std::sqrt(reading.strays)) +
         2 * reading.pushed;
}

bool MonitoredCycle::stands(int c, Real share) const {
  const MonitoredReading& reading = monitor_.reading[c];
  return stood(c, reading.way) > much(c, share) ||
         (!monitor_.undecided && std::fabs(reading.way) > much(c, kStoodBy));
}

Real MonitoredCycle::asked(int c) const {
  if (c < n) return desired_[c] + monitor_.led[c];
  Real value = parity_.expected[c];
  for (int j = 0; j < n; ++j) value += parity_.g[c - n][j] * (desired_[j] - parity_.expected[j]);
  return number(value) ? value : monitor_.reading[c].asked;
}

Real MonitoredCycle::told(int sensor) const {
  Real sum = 0;
  for (int j = 0; j < n; ++j) sum += parity_.g[sensor - n][j] * (desired_[j] - monitor_.desired[j]);
  return number(sum) ? sum : 0;
}

Real MonitoredCycle::stood(int c, Real way) const {
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

bool MonitoredCycle::replaceable(int c, Real left, Reading g, const ReadingCovariance& V,
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

bool MonitoredCycle::stale() {
  for (int i = 0; i < dof(robot_.mobility); ++i) monitor_.way += std::fabs(monitor_.motion[i]);
  const bool far = monitor_.way > kSamePlace * settings_.correlation;
  if (!far && monitor_.cycle % settings_.refresh != 0) return false;
  monitor_.way = 0;
  return true;
}

void MonitoredCycle::refresh() {
  const Knowledge& known = *weighing_.known;
  Real *H_xi = weighing_.work, *B = H_xi + rows_ * parameter_count(robot_);
  Extended beyond;
  monitor_.known = bool(geometry_at(robot_, monitor_.pose, H_xi, beyond));
  if (!monitor_.known) return;
  parity_.open(robot_, known, H_xi, B);
  for (int k = 0; k < r_; ++k)
    for (int l = 0; l <= k; ++l)
      monitor_.geometry[k][l] = dot(known.count, B + k * known.count, B + l * known.count);
  Reading more{};
  for (int k = 0; k < r_; ++k) {
    more[k] = beyond[n + k] - monitor_.beyond[n + k];
    for (int j = 0; j < n; ++j) more[k] -= parity_.g[k][j] * (beyond[j] - monitor_.beyond[j]);
    if (!number(more[k])) continue;  // the parity's tracker must not see a change,
    monitor_.parity[k].value -= more[k];
    monitor_.usual[k] -= more[k];
    monitor_.reading[n + k].model += more[k];  // nor a sensor that stands still a motion
    monitor_.reading[n + k].asked += more[k];
  }
  monitor_.beyond = beyond;
}
}  // namespace truepose::fault_monitor_detail
