// One cycle of the fault monitor: inputs, intermediate results, and its steps, a file for each
// idea.
#pragma once

#include "control/fault_monitor_state.hpp"
#include "control/multirate.hpp"
#include "control/parity.hpp"
#include "estimation/evidence.hpp"

namespace truepose::fault_monitor_detail {
/// As of monitor_faults().
struct MonitoredInputs {
  const Robot& robot;
  const FaultMonitorSettings& settings;
  const Weighing& weighing;
  const Joint& desired;
  Extended q_e;  ///< readings; delayed ones extrapolated to now
  FaultMonitor& monitor;
  Extended& believed;
  Multirate* late;
};

struct MonitoredCycle : MonitoredInputs {
  const int n = robot.motors, r = robot.r, rows = n + r;
  Parity parity;
  Extended noise{};               ///< variances of the readings' own errors
  Extended unknown{};             ///< of the errors of excluded readings
  int left_out = 0;               ///< their number
  Extended innovation{};          ///< of each reading's track
  std::uint32_t symptomatic = 0;  ///< readings with a symptom in this cycle,
  std::uint32_t standing = 0;     ///< those of them that are stuck
  std::uint32_t without = 0;      ///< excluded readings,
  std::uint32_t replaced = 0;     ///< those of them that the others give
  std::uint32_t held = 0;         ///< candidate motors held at their setpoints

  explicit MonitoredCycle(const MonitoredInputs& inputs) : MonitoredInputs(inputs) {}

  /// All steps. @return as of monitor_faults()
  Outcome run();

  bool delayed(int c) const { return late && c >= n && late->is(c - n); }
  int every(int c) const { return delayed(c) ? max(1, late->settings.every[c - n]) : 1; }
  /// Value that the model gives a reading: a motor's setpoint, a sensor's by the motors.
  Real model(int c) const;
  /// Value whose changes show that a reading moves: of a delayed sensor its last sample.
  Real raw(int c) const { return delayed(c) ? late->sample[c - n] : q_e[c]; }

  // A reading by itself: reading_tests.cpp
  void test_readings(int begin, int end);
  Symptom symptom_of(int c) const;
  /// Of innovations, by noise and the usual motion.
  Real track_variance(int c) const;
  /// Excludes a reading in this cycle. Too long, or too often, and it has failed; one that stands
  /// still gets twice the time.
  void extrapolate(int c, Symptom symptom);
  /// Extrapolates delayed readings to the present by the believed motors.
  void extrapolate_delayed();

  // A reading that stands still while its model moves: standstill.cpp
  /// Largest model motion while a healthy reading stands still. @param share  of `moved`
  Real tolerated_motion(int c, Real share) const;
  /// Model motion beyond noise since the reading changed last. @param way  by which its loop has
  /// driven the motor off
  Real model_motion(int c, Real way) const;
  /// Value to which a reading is led: a motor's by its drive, a sensor's by q_d, linear from the
  /// motors' pose.
  Real setpoint(int c) const;
  /// Whether the parity contradicts a frozen encoder of a motor that has moved on: a force or
  /// friction holds the motor. @param moved  by the model
  bool motor_stands(int c, Real moved) const;
  void update_standstill(int c, bool judged);

  // The parity of all readings, and its evidence: parity_evidence.cpp
  /// Factors V. @param gain  on the readings' own variances @param share  on the geometry's
  bool covariance(Real gain, Real share, ReadingCovariance& V) const;
  /// σ of the geometry's error in the change of the parity, as a share of the whole error. That
  /// error is a function of the pose: an acceleration changes it as far as the pose, a velocity by
  /// its square.
  Real bending() const;
  /// Whether χ² of a parity is beyond its limit. @param gain, share  as of covariance()
  bool alarm(Real gain, Real share, const Reading& value);
  void test_parity();
  /// Signature of a reading, whitened, over a parity. @param y  whitened
  Column column_of(int c, const ReadingCovariance& V, const Reading& y) const;
  /// Log odds of an error of each reading against none. @param mean  parity, of covariance V
  /// @param jumped  the parity has changed: the reading's track counts, too
  Extended log_odds(const ReadingCovariance& V, const Reading& mean, bool jumped) const;
  /// Readings whose error explains the disagreement: those whose odds are not decisively worse.
  std::uint32_t candidates(bool jumped, Real bend) const;

  // Substitution, and the geometry's part of the parity: substitution.cpp
  /// Takes a reading's error as unknown: with a variance that hides it in every equation.
  void exclude(int c);
  /// Substitutes the excluded readings; failed ones have unknown errors, b̂ = Σ_b GᵀV⁻¹ p.
  void substitute();
  /// Whether b̂ may drive a motor: its σ², and its variance from the readings' own errors, Σ_b²
  /// gᵀV⁻¹ V_s V⁻¹g, which is new in every cycle and shakes the velocity loop.
  /// @param left  variance of b̂ @param own  V_s
  bool replaceable(int c, Real left, const ReadingCovariance& V,
                   const ReadingCovariance& own) const;
  /// Following error of an extrapolated motor; of a stuck one as its loop reduces it.
  Real extrapolated_error(int c);
  /// Updates the geometry's covariance and the full level's addition, where the pose is another one
  /// or, with online calibration, they are outdated.
  void refresh();

  /// Updates the state of every reading. @return the first that is not valid, or -1
  int update();
  void update_parity();
};
}  // namespace truepose::fault_monitor_detail
