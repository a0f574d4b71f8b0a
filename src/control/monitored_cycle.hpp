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

  const int n = robot_.motors, r_ = robot_.r, rows_ = n + r_;
  bool settled_ = monitor_.cycle - monitor_.began > kSettling;
  Parity parity_;
  Extended noise_{};               ///< variances of the readings' own errors
  Extended unknown_{};             ///< of unknown errors
  int left_out_ = 0;               ///< their number
  Extended innovation_{};          ///< of each reading's own tracker
  std::uint32_t symptomatic_ = 0;  ///< extrapolated readings,
  std::uint32_t standing_ = 0;     ///< those of them that stand still
  std::uint32_t still_ = 0;        ///< isolated by standing still
  std::uint32_t without_ = 0;      ///< excluded readings,
  std::uint32_t replaced_ = 0;     ///< those of them that the others give
  std::uint32_t held_ = 0;         ///< candidate motors held at their setpoints

  // Not an aggregate: that would be filled with zeros first.
  MonitoredCycle(const Robot& robot, const FaultMonitorSettings& settings, const Weighing& weighing,
                 const Joint& desired, const Extended& q_e, FaultMonitor& monitor,
                 Extended& believed, Multirate* late);

  /// False also where later numbers would overflow.
  static bool number(Real raw) { return std::fabs(raw) < kNoNumber; }

  bool late(int c) const { return late_ && c >= n && late_->is(c - n); }
  int every(int c) const { return late(c) ? std::max(1, late_->settings.every[c - n]) : 1; }

  /// Whether no motor's reading has failed.
  bool motors_valid() const;

  Symptom symptom_of(int c) const;

  /// Whether a reading's track and the limit of its acceleration are known.
  bool followed(int c) const;

  /// Cycles without a reading before this one. One that jumped must return to its prediction.
  int missed(int c) const;

  /// Deviation from a reading's prediction beyond what the largest acceleration explains.
  Real off_track(int c) const;

  /// Factors V. @param gain  on the readings' own variances @param share  on the geometry's
  bool covariance(Real gain, Real share, ReadingCovariance& V) const;

  /// σ of the geometry's error in the parity tracker's innovation, as a share of the whole error.
  /// That error is a function of the pose: an acceleration changes it as far as the pose, a
  /// velocity by its square.
  Real bending() const;

  static constexpr int kLongest = 1000;  ///< cycles, counted at most
  /// Share of `moved` above which a reading that stands still during an alarm is isolated, or one
  /// whose motor was driven off.
  static constexpr Real kStoodBy = 0.4;
  /// Share of `moved` by which asked() must have left a reading that stands still.
  static constexpr Real kAsked = 0.2;
  /// σ by which a motor may deviate from its usual following error.
  static constexpr Real kStrays = 8;

  bool leaves_track(int c, Real innovation) const;

  /// Whether a motor left its track since a delayed sample was taken, which shows it only now.
  bool motor_left(int c) const;

  Real model(int c) const;

  /// Value whose changes show that a reading moves: of a delayed sensor its last sample.
  Real raw(int c) const { return late(c) ? late_->sample[c - n] : q_e_[c]; }

  /// Largest model motion while a reading stands still. A motor that oscillates about its path, for
  /// example by a law with a delayed sensor, stands still at its turning points while its setpoint
  /// moves on: its usual deviation counts.
  Real much(int c, Real share) const;

  /// Whether a reading stands still for longer than between its samples. An error that friction
  /// cannot hold must have driven a motor off its count, unless it was held at its setpoint.
  bool stands(int c, Real share) const;

  /// Value to which a reading is led: a motor's by its drive, a sensor's by q_d, linear from the
  /// motors' pose.
  Real asked(int c) const;

  /// Motion of the setpoint in this cycle, as a sensor would read it.
  Real told(int sensor) const;

  /// Model motion beyond noise since the reading changed last: of a motor the smaller of that and
  /// of its distance from it, so that motion towards it does not count. A law that holds a platform
  /// moves its motors where one of them drifts, and the sensor stands at its setpoint; where a
  /// sensor is wrong, a motor that the law leads against its setpoint turns back. Motion therefore
  /// counts once asked() has left the reading that way by kAsked of `moved`.
  /// @param way  by which its loop has driven the motor off
  Real stood(int c, Real way) const;

  /// Whether b̂ may drive a motor: its σ², and its variance from the readings' own errors, Σ_b²
  /// gᵀV⁻¹ V_s V⁻¹g, which is new in every cycle and shakes the velocity loop.
  /// @param left  variance of b̂ @param g  signature of the reading, whitened by V @param own  V_s
  bool replaceable(int c, Real left, Reading g, const ReadingCovariance& V,
                   const ReadingCovariance& own) const;

  /// Whether the geometry's covariance is of another pose or, with online calibration, outdated.
  bool stale();

  /// Updates the geometry's covariance and the full level's addition at the present pose.
  void refresh();
};
}  // namespace truepose::fault_monitor_detail
