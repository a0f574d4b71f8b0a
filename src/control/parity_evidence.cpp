// Parity tests and the evidence for a faulty reading.
//
// Level: the parity must not be larger than readings and geometry allow. Change: the geometry's
// part depends on the pose alone and changes slowly, so the innovation of a tracker of the parity
// has little more than the readings' noise and reveals sudden faults far below the level.
//
// While they disagree, each reading is a hypothesis: one more column, its signature g, with an
// unknown constant error b from the first cycle on. Of the mean parity p of these cycles, b
// explains (gᵀV⁻¹p)²/(gᵀV⁻¹g) of χ² (generalised likelihood ratio). If the reading jumped, so did
// its track: the innovation there is one more row of b. A reading that stands still while its model
// moves has evidence of its own. Half of the part that a hypothesis explains is its log odds
// against none.
#include "control/monitored_cycle.hpp"

namespace truepose::fault_monitor_detail {
bool MonitoredCycle::covariance(Real gain, Real share, ReadingCovariance& V) const {
  Extended variance;
  for (int c : range(rows)) variance[c] = gain * noise[c] + unknown[c];
  parity.covariance(r, variance, monitor.geometry, monitor.known ? share : 0, V);
  return V.factor(r);
}

Real MonitoredCycle::bending() const {
  Real way2 = 0, bend2 = 0;
  for (int i : range(dof(robot.mobility))) {
    const Real bend = monitor.motion[i] - monitor.last[i];
    way2 += monitor.motion[i] * monitor.motion[i];
    bend2 += bend * bend;
  }
  const Real per = 1 / settings.correlation;
  return settings.together.acceleration * per * (sqrt(bend2) + way2 * per);
}

bool MonitoredCycle::alarm(Real gain, Real share, const Reading& value) {
  ReadingCovariance V;
  if (!covariance(gain, share, V)) return false;
  monitor.chi2 = chi_squared(V, r, value);
  monitor.freedom = max(0, r - left_out);
  return monitor.freedom > 0 && !(monitor.chi2 <= settings.chi2[std::size_t(monitor.freedom)]);
}

Column MonitoredCycle::column_of(int c, const ReadingCovariance& V, const Reading& y) const {
  Reading g = parity.signature(r, c);
  V.whiten(r, g.data(), 1);
  Column column;
  for (int k : range(r)) column.add(g[k], y[k]);
  return column;
}

Extended MonitoredCycle::log_odds(const ReadingCovariance& V, const Reading& mean,
                                  bool jumped) const {
  Reading y = mean;
  V.whiten(r, y.data(), 1);
  Extended odds;
  odds.fill(-INFINITY);
  for (int c : range(rows)) {
    Column error = column_of(c, V, y);
    if (without & bit(c) || !(error.information > 0)) continue;
    odds[c] = error.chi2() / 2;
    // What a delayed sensor shows now may be an earlier jump of a motor.
    bool motor_left = false;
    for (int i = 0; delayed(c) && i < n; ++i)
      motor_left |=
          monitor.cycle - monitor.reading[i].left_track <= 1 + every(c) + late->age[c - n];
    if (const Real own = track_variance(c); jumped && !motor_left && own > 0) {
      error.add(1, monitor.disagreement.jump[c], own);
      odds[c] = max(odds[c], error.chi2() / 2);
    }
    // While another motor's fault moves the robot, a healthy one may stand off its setpoint.
    const bool stands = settings.moved[c] > 0 && raw(c) == monitor.reading[c].standstill.reading;
    const Real motion = stands ? model_motion(c, 0) / tolerated_motion(c, kStoodBy) : 0;
    if (motion > 0) odds[c] += settings.decisive * motion * motion;
  }
  return odds;
}

std::uint32_t MonitoredCycle::candidates(bool jumped, Real bend) const {
  const Disagreement& all = monitor.disagreement;
  const Real share = Real{1} / all.cycles;
  Reading mean;
  for (int k : range(r)) mean[k] = share * (jumped ? all.change[k] : all.level[k]);
  ReadingCovariance V;
  // The tracker's own error is common to these cycles.
  const Real gain = jumped ? settings.together.variance - 1 + share : share;
  if (!covariance(gain, jumped ? bend * bend : 1, V)) return 0;
  const Extended odds = log_odds(V, mean, jumped);
  const Real best = *std::max_element(odds.begin(), odds.begin() + rows);
  std::uint32_t alike = 0;
  for (int c : range(rows))
    if (odds[c] > -INFINITY && odds[c] >= best - settings.decisive) alike |= bit(c);
  return alike;
}

void MonitoredCycle::test_parity() {
  Disagreement& all = monitor.disagreement;
  Reading change{};
  for (int k : range(r)) change[k] = parity.value[k] - monitor.parity[k].predicted(settings.period);
  // During a disagreement the tracker only predicts, for some cycles.
  const Real coasted = 1 + 0.5 * all.undecided * (1 - kParityPole);
  const Real bend = bending() * coasted * coasted;
  const bool changed = !monitor.undecided && alarm(settings.together.variance, bend * bend, change);
  const bool level = monitor.known && alarm(1, 1, parity.value);
  if (!changed && !level) {
    if (!monitor.undecided) monitor.doubted = 0;
    if (all.cycles > 0 && --all.undecided <= 0) all = {};
    return;
  }
  if (!monitor.undecided) {  // a stopping robot behaves differently
    if (all.cycles++ == 0) all.jump = innovation;
    for (int k : range(r)) {
      all.change[k] += change[k];
      all.level[k] += parity.value[k];
    }
    monitor.doubted = candidates(changed, bend);
  }
  if (monitor.doubted & (monitor.doubted - 1)) {  // several
    // A drift exceeds its limit now and then at first, then always.
    if (!monitor.undecided) all.undecided += 2;
    monitor.undecided = monitor.undecided || all.undecided > 2 * settings.decide;
    // A motor that stands still gets its setpoint: a frozen encoder would drive it away. Once it
    // does, sensors get the value by the mean parity before, otherwise without the change.
    bool driven = false;
    for (int c = 0; c < n && !monitor.undecided; ++c)
      if (monitor.doubted & bit(c) & ~without && monitor.reading[c].standstill.cycles >= kStill) {
        held |= bit(c);
        driven = driven || monitor.reading[c].standstill.may_be_frozen();
        if (isfinite(desired[c])) believed[c] = desired[c] - monitor.reading[c].following.now;
      }
    for (int k : range(r))
      believed[n + k] -= driven ? parity.value[k] - monitor.usual[k] : change[k];
    return;
  }
  for (int c : range(rows)) {
    if (!(monitor.doubted & bit(c))) continue;
    Standstill& still = monitor.reading[c].standstill;
    still.stuck = !delayed(c) && raw(c) == still.reading &&
                  model_motion(c, 0) > tolerated_motion(c, kStoodBy);
    extrapolate(c, still.stuck ? Symptom::stuck : Symptom::disagrees);
    exclude(c);
  }
  all = {};
  monitor.doubted = 0;
}
}  // namespace truepose::fault_monitor_detail
