// Detection and isolation of faulty readings (FDI).
#include "control/fault_monitor.hpp"

#include "control/monitored_cycle.hpp"

namespace truepose {
namespace fault_monitor_detail {
namespace {
/// The steps of one cycle, which update the state and the believed readings.
class Cycle : MonitoredCycle {
 public:
  using MonitoredCycle::MonitoredCycle;

  Outcome run() {
    // Starts at the first readings that have a pose: earlier, a motor has no substitute.
    const bool first_cycle = monitor_.cycle == 0;
    for (int c = 0; first_cycle && c < n; ++c)
      if (!number(q_e_[c])) {
        monitor_.reading[c].health = Health::suspect;
        monitor_.reading[c].symptom = Symptom::missing;
        return {Status::not_finite, c};
      }
    test_readings(0, n);
    if (late_) extrapolate_delayed();
    test_readings(n, rows_);
    const Outcome placed = locate();
    if (!placed && first_cycle) return placed;
    if (!placed && monitor_.cycle == monitor_.began) ++monitor_.began;
    if (placed) {
      for (int c = 0; c < rows_; ++c)
        if (without_ & bit(c)) exclude(c);
      if (r_ > 0 && settled_) test_parity();
      if (without_) substitute();
      monitor_.last = monitor_.motion;
      monitor_.motion = monitor_.placed ? difference(robot_.mobility, parity_.pose, monitor_.pose)
                                        : Coordinates{};
      monitor_.pose = parity_.pose;
    }
    monitor_.placed = bool(placed);
    const int first = update();
    if (placed && r_ > 0 && stale()) refresh();
    ++monitor_.cycle;
    if (!placed) return placed;
    return {first < 0 ? Status::ok : Status::disagree, first};
  }

 private:
  /// Extrapolates multirate readings to the present by the believed motors.
  void extrapolate_delayed() {
    Extended by = q_e_;
    std::copy_n(believed_.begin(), n, by.begin());
    if (!compensate_latency(robot_, *late_, by)) return;
    std::copy_n(by.begin() + n, r_, q_e_.begin() + n);
    const bool motors = motors_valid();  // a delayed reading cannot substitute a motor
    for (int c = 0; c < rows_; ++c) {
      if (late(c) && !motors) {
        noise_[c] = 1;
      } else if (late(c)) {
        noise_[c] += late_detail::latency_variance(*late_, c - n, late_->before[c - n]);
      } else if (c < n && leaves_track(c, innovation_[c])) {
        monitor_.reading[c].left = monitor_.cycle;
      }
    }
  }

  /// Tests readings by themselves, and predicts them.
  void test_readings(int begin, int end) {
    for (int c = begin; c < end; ++c) {
      MonitoredReading& reading = monitor_.reading[c];
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
      // Whole turns that an encoder has lost or passed since the start are no motion.
      believed_[c] = innovation_[c] == news ? q_e_[c] : predicted + innovation_[c];
      if (reading.health != Health::failed) {
        const Symptom symptom = symptom_of(c);
        if (symptom == Symptom::none) continue;
        if (symptom == Symptom::stuck) standing_ |= bit(c);
        bridge(settings_, monitor_.cycle, symptom, every(c), reading);
        if (!reading.begun) reading.health = Health::failed;  // nothing to extrapolate from
        symptomatic_ |= bit(c);
      }
      without_ |= bit(c);
      believed_[c] = predicted;
    }
  }

  Outcome locate() {
    Pose near = moved(robot_.mobility, monitor_.pose, monitor_.motion);
    if (!monitor_.placed) {
      near = to_pose(robot_.mobility, robot_.home);
      const Outcome found{fkm(robot_, motors_of(robot_, believed_), near).status, -1};
      if (!found) return found;
    }
    return parity_.locate(robot_, near, believed_, monitor_.beyond);
  }

  /// Takes a reading's error as unknown: with a variance that hides it in every equation.
  void exclude(int c) {
    const Reading g = parity_.signature(r_, c);
    Real size = 0, known = 0;
    for (int k = 0; k < r_; ++k) {
      size += g[k] * g[k];
      known += noise_[n + k] + monitor_.geometry[k][k];
      for (int j = 0; j < n; ++j) known += parity_.g[k][j] * parity_.g[k][j] * noise_[j];
    }
    if (!(size > 0 && known > 0)) return;
    unknown_[c] = kUnknown * known / size;
    ++left_out_;
  }

  /// Tests level and change of the parity.
  void test_parity() {
    Reading change{};
    for (int k = 0; k < r_; ++k)
      change[k] = parity_.value[k] - monitor_.parity[k].predicted(settings_.period);
    Verdict changed, level;
    ReadingCovariance V;
    // During a disagreement the tracker only predicts, for some cycles.
    const Real coasted = 1 + 0.5 * monitor_.disagreed * (1 - kParityPole);
    const Real bend = bending() * coasted * coasted;
    if (!monitor_.undecided && covariance(settings_.together.variance, bend * bend, V))
      changed = parity_verdict(parity_, settings_.chi2, V, change, r_, without_, left_out_);
    if (monitor_.known && covariance(1, 1, V)) {
      level = parity_verdict(parity_, settings_.chi2, V, parity_.value, r_, without_, left_out_);
      monitor_.chi2 = level.chi2;
      monitor_.freedom = level.freedom;
    }
    if (!changed.alarm && !level.alarm) {
      monitor_.disagreed = std::max(0, monitor_.disagreed - 1);
      if (!monitor_.undecided) monitor_.doubted = 0;
      return;
    }
    isolate(changed, level);
    if (monitor_.doubted & (monitor_.doubted - 1)) {  // several
      // A drift exceeds its limit now and then at first, then always.
      if (!monitor_.undecided) monitor_.disagreed += 2;
      monitor_.undecided = monitor_.undecided || monitor_.disagreed > 2 * settings_.decide;
      // Before isolation a motor that stands still gets its setpoint: a frozen encoder would drive
      // it away. Once it does, sensors get the value by the mean parity before, otherwise without
      // the change.
      bool driven = false;
      for (int c = 0; c < n && !monitor_.undecided; ++c)
        if (monitor_.doubted & bit(c) & ~without_ && monitor_.reading[c].still >= kStill) {
          held_ |= bit(c);
          driven = driven || monitor_.reading[c].seems != 0;
          if (std::isfinite(desired_[c])) believed_[c] = desired_[c] - monitor_.reading[c].behind;
        }
      for (int k = 0; k < r_; ++k)
        believed_[n + k] -= driven ? parity_.value[k] - monitor_.usual[k] : change[k];
      return;
    }
    monitor_.disagreed = 0;
    for (int c = 0; c < rows_; ++c) {
      if (!(monitor_.doubted & bit(c))) continue;
      const bool stays = still_ & bit(c) && !late(c);
      monitor_.reading[c].stands = stays;
      bridge(settings_, monitor_.cycle, stays ? Symptom::stuck : Symptom::disagrees, every(c),
             monitor_.reading[c]);
      symptomatic_ |= bit(c);
      without_ |= bit(c);
      exclude(c);
    }
    monitor_.doubted = 0;
  }

  /// Narrows down the readings that alone may be faulty.
  void isolate(const Verdict& changed, const Verdict& level) {
    if (monitor_.undecided) return;  // a stopping robot behaves differently
    const std::uint32_t first = changed.alarm ? changed.may : ~0U;
    const std::uint32_t second = level.alarm ? level.may : ~0U;
    std::uint32_t may = first & second ? first & second : first | second;
    may &= bit(rows_) - 1;
    const auto alone = [](std::uint32_t set) { return set && !(set & (set - 1)); };
    std::uint32_t still = 0, apart = 0;
    for (int c = 0; c < rows_; ++c) {
      if (without_ & bit(c)) continue;
      // While another motor's fault moves the robot, a healthy one may stand off its setpoint.
      if (raw(c) == monitor_.reading[c].raw && stood(c, 0) > much(c, kStoodBy)) still |= bit(c);
      if (leaves_track(c, innovation_[c]) && !motor_left(c)) apart |= bit(c);
    }
    if (alone(may & still)) {
      may &= still;
      still_ = may;
    } else if (changed.alarm && alone(apart) && may & apart) {
      for (int c = 0; c < rows_; ++c)
        if (apart & bit(c) && !leaves_track(c, innovation_[c] - changed.by[c])) may = apart;
    }
    const std::uint32_t both = monitor_.doubted & may;
    monitor_.doubted = both ? both : may;
  }

  /// Phantom error of a frozen encoder: δ, the motion of its drive's setpoint since the reading
  /// changed last. It drives the motor off that by ∬ kp δ + kd dδ/dt. An error at which a healthy
  /// motor may rest drives nothing and lets it stop.
  void integrate_phantom(int c) {
    MonitoredReading& reading = monitor_.reading[c];
    const Real away = asked(c) - reading.asked;
    const Real bears = settings_.rests[c] + 2 * reading.pushed;
    const Real seems = away > bears ? away - bears : away < -bears ? away + bears : 0;
    const Real most =
        settings_.fastest[c] > 0 ? settings_.period * settings_.fastest[c] : kNoNumber;
    reading.speed += std::clamp(
        settings_.period * settings_.kp[c] * seems + settings_.kd[c] * (seems - reading.seems),
        -most, most);
    if (seems == 0) reading.speed = 0;
    reading.seems = seems;
    reading.way += settings_.period * reading.speed;
  }

  /// Updates a motor's following error and, while it moves, mean and variance of that.
  void trail(int c) {
    MonitoredReading& reading = monitor_.reading[c];
    reading.behind = desired_[c] - believed_[c];
    const Real off = reading.behind - reading.usual;
    if (reading.still > 0 || !number(off)) return;
    reading.off = off;
    reading.usual += off / kSettling;
    reading.strays += (off * off - reading.strays) / kSettling;
  }

  /// Following error of an extrapolated motor; of one that stands still, as its loop reduces it.
  Real behind(int c) {
    MonitoredReading& reading = monitor_.reading[c];
    if (!reading.stands) return reading.behind;
    Tracker& led = reading.led_out;
    led.rate = (led.rate - settings_.period * settings_.kp[c] * led.value) /
               (1 + settings_.period * settings_.kd[c]);
    return led.value = led.predicted(settings_.period);
  }

  /// Substitutes the excluded readings; failed ones have unknown errors, b̂ = Σ_b GᵀV⁻¹ p.
  void substitute() {
    ReadingCovariance V, own;
    const bool regular = r_ > 0 && covariance(1, 1, V);
    if (regular) parity_.covariance(r_, noise_, monitor_.geometry, 0, own);
    Reading y = parity_.value;
    if (regular) V.whiten(r_, y.data(), 1);
    Coordinates step{};
    for (int c = 0; c < rows_; ++c) {
      if (!(without_ & bit(c))) continue;
      const bool failed = monitor_.reading[c].health == Health::failed;
      const bool stands = monitor_.reading[c].stands;
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
      // A lost motor stays lost: its brake is closing.
      const bool lost = monitor_.lost & bit(c);
      if ((failed || (stands && c < n)) && good && number(b) && !lost &&
          (c >= n || replaceable(c, left, g, V, own))) {
        replaced_ |= bit(c);
        believed_[c] -= b;
        if (c < n)
          for (int i = 0; i < dof(robot_.mobility); ++i) step[i] -= parity_.jacobians.J[i][c] * b;
      } else if (!failed) {
        // Extrapolated: a sensor follows the motors, a motor its setpoint.
        believed_[c] = monitor_.reading[c].own.predicted(settings_.period);
        if (c < n && std::isfinite(desired_[c])) believed_[c] = desired_[c] - behind(c);
        if (c >= n && (late(c) || !(without_ & (bit(n) - 1))))
          believed_[c] = parity_.read[c] - parity_.value[c - n] +
                         monitor_.parity[c - n].predicted(settings_.period);
      } else if (c < n) {
        monitor_.lost |= bit(c);
        believed_[c] = desired_[c];  // the motor's error is 0
      } else {
        believed_[c] = parity_.read[c] - parity_.value[c - n];  // as far as the motors determine it
      }
    }
    parity_.pose = moved(robot_.mobility, parity_.pose, step);
  }

  /// Updates the state of every reading. @return the first that is not valid, or -1
  int update() {
    int first = -1;
    std::uint32_t without = 0;
    const bool motors = monitor_.placed && motors_valid();  // whether they give the pose
    for (int c = 0; c < rows_; ++c) {
      MonitoredReading& reading = monitor_.reading[c];
      // With a lost motor the robot does not follow its setpoint. While it stops on an undecided
      // fault it does: the faulty motor may still be isolated.
      const bool judged = (!monitor_.doubted || (monitor_.undecided && c < n)) &&
                          !(symptomatic_ & ~standing_) && !monitor_.lost &&
                          settings_.moved[c] > 0 && (c < n || motors);
      // Setpoints are known from the second cycle on.
      if (raw(c) != reading.raw || monitor_.cycle - monitor_.began < 2) {
        reading.stands = false;
        if (c < n) reading.pushed = monitor_.pushed[c];
        reading.raw = raw(c);
        if (c < n || monitor_.placed) {
          reading.model = model(c);
          reading.asked = asked(c);
        }
        reading.seems = reading.speed = reading.way = reading.told = 0;
        reading.still = 0;
      } else {
        if (c >= n && monitor_.placed) reading.told += told(c);
        if (reading.still < kLongest) ++reading.still;  // a robot may stand still for months
        if (c < n && !reading.stands) integrate_phantom(c);
        if (judged && reading.health != Health::failed && stands(c, monitor_.undecided ? 3 : 1)) {
          reading.stands = true;
          reading.led_out = {reading.usual + reading.off, 0};
          if (late(c) || monitor_.undecided) {
            reading.health = Health::failed;
            reading.symptom = Symptom::stuck;
          }
        }
      }
      const bool believed = !(without_ & bit(c));
      Real news = innovation_[c];  // an excluded reading follows its substitute
      if (!believed) news = believed_[c] - reading.own.predicted(settings_.period);
      if (believed) {
        if (reading.health == Health::suspect) reading.health = Health::valid;
        reading.bridged = 0;
        if (c < n) trail(c);
        reading.spread += (innovation_[c] * innovation_[c] - reading.spread) / kSettling;
      }
      reading.own.correct(settings_.period, kOwnPole, number(news) ? news : 0);
      if (monitor_.doubted & bit(c) && reading.health == Health::valid)
        reading.health = Health::suspect;
      if (!believed && (reading.health == Health::failed || replaced_ & bit(c))) without |= bit(c);
      if (first < 0 && reading.health != Health::valid) first = c;
    }
    for (int k = 0; k < r_ && monitor_.placed; ++k) {
      Tracker& parity = monitor_.parity[k];
      const Real change = parity_.value[k] - parity.predicted(settings_.period);
      if (monitor_.cycle == monitor_.began) parity = {parity_.value[k], 0};
      const bool holds = monitor_.doubted || symptomatic_;  // no correction by a possible fault
      Real& usual = monitor_.usual[k];
      if (monitor_.cycle == monitor_.began) usual = parity_.value[k];
      if (!holds && number(parity_.value[k])) usual += (parity_.value[k] - usual) / kSettling;
      parity.correct(settings_.period, kParityPole, holds || !number(change) ? 0 : change);
      if (holds) parity.rate *= kParityPole;
    }
    monitor_.desired = desired_;
    monitor_.changed = monitor_.without != without || (monitor_.held & ~held_) != 0;
    monitor_.without = without;
    monitor_.held = held_;
    return first;
  }
};
}  // namespace
}  // namespace fault_monitor_detail

Outcome monitor_faults(const Robot& robot, const FaultMonitorSettings& settings,
                       const Weighing& weighing, const Joint& desired, const Extended& q_e,
                       FaultMonitor& monitor, Extended& believed, Multirate* late) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (!weighing) return {Status::not_measured, -1};
  return fault_monitor_detail::Cycle(robot, settings, weighing, desired, q_e, monitor, believed,
                                     late)
      .run();
}
}  // namespace truepose
