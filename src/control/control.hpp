// One control cycle: readings and setpoint in, motor torques out.
#pragma once

#include "control/dynamics.hpp"
#include "control/law.hpp"
#include "control/trajectory.hpp"

namespace truepose {
enum class FeedForward : int {
  none = 0,
  gravity = 1,  ///< holds the nominal robot at x_d
  full = 2,     ///< gravity, inertia and Coriolis of the nominal robot along the trajectory
};

/// What kp, kd and ki mean.
enum class Gains : int {
  diagonal = 0,  ///< torques, each motor's from its own error alone: N·m/rad (N/m) and so on
  inertia = 1,   ///< accelerations, 1/s², 1/s and 1/s³, that the joint inertia turns into torques
};

/// Constant during a run.
struct ControlSettings {
  std::uint32_t size = sizeof(truepose_control_settings);  ///< for the C interface
  Law law = Law::joint;
  Gains gains = Gains::diagonal;
  FeedForward feed_forward = FeedForward::full;
  /// Factor on every reading's own σ in laws that weigh. A calibration leaves errors that nearly
  /// cancel in the readings; their optimal weights multiply differences of readings, hence also the
  /// effects of arms and drives on these. Larger σ, smaller multiples.
  int sigma_scale = 1;
  int unused = 0;
  Real period = 1e-3;              ///< s
  Real velocity_bandwidth = 1500;  ///< of the velocity tracking loops, rad/s
  Real damped_below = 0;           ///< conditioning below which J is damped (0: never)
  Real lead_out = 0.2;             ///< time over which a switch of law or readings takes effect, s
  Joint kp{};                      ///< N·m/rad (N/m), or 1/s²
  Joint kd{};                      ///< N·m·s/rad, or 1/s
  Joint ki{};                      ///< N·m/(rad·s), or 1/s³; 0: no integral action
};

/// State of a controller. Zero it to switch the controller on.
struct ControlState {
  bool started = false;
  Extended position{};    ///< of the tracking loops: the readings, or x̂
  Extended rate{};        ///< of the tracking loops: rates of the error, desired minus actual
  Extended desired{};     ///< desired rate in the last cycle
  Joint integral{};       ///< N·m
  Joint torque{};         ///< the last one commanded; held when a cycle fails
  Joint error{};          ///< ê_q of the last good cycle
  Joint error_rate{};     ///< its rate, estimated
  Joint q_d{};            ///< desired motor readings a period later, extrapolated
  Joint load{};           ///< feed-forward and integral part of the torque, N·m
  Nearby nearby;          ///< start of the next cycle's closings and search for x̂
  Law law = Law::joint;   ///< whose terms `position` and `rate` are in
  bool switched = false;  ///< set where readings are substituted: prevents a step
  Joint held{};           ///< ê_q before the last switch minus ê_q after it,
  Real leaving = 0;       ///< and the time over which it is still led out, s
  /// Motors with requested brakes, as bits: only their feed-forward acts.
  std::uint32_t braked = 0;
};

/// Rate of an error from a quantized reading, as in a drive: a second-order tracking loop (α-β
/// filter) with both poles at p = exp(-bandwidth · period), hence stable for any bandwidth.
///
/// A loop on the reading y alone estimates ẏ with a lag of about 2/bandwidth,
/// F(s) = 1 / (1 + s/b)². Then ẏ_d - Fẏ demands (1 - F) ẏ_d of a robot that follows exactly, which
/// costs a tracking error of (kd/kp) (1 - F) ẏ_d. Here ẏ_d passes the same filter, F (ẏ_d - ẏ): the
/// loop predicts y from the desired rate minus its estimate ė,
///
///     ŷ(k) = ŷ(k-1) + T ((ẏ_d(k-1) + ẏ_d(k)) / 2 - ė(k-1)),
///
/// and the innovation corrects ė alone. The trapezoid is accurate to T³. Only the rate of y_d
/// enters, on purpose: a step of the setpoint moves no reading and causes no kick.
/// @param reading   y
/// @param expected  mean rate of y_d in the period that has passed
/// @param position  in and out: ŷ
/// @param rate      in and out: ė
void track(const ControlSettings& settings, Real pole, Real reading, Real expected, Real& position,
           Real& rate);

/// Limits a torque to the motor's.
inline Real limited(const Chain& chain, Real torque) {
  const Real limit = chain.torque_limit;
  return limit > 0 ? clamp(torque, -limit, limit) : torque;
}

/// Runs one cycle. Bounded work, no allocation, no exception, no lock.
/// @param q_e    readings of motors and sensors, size m + r
/// @param state  in and out; state.torque is the command
/// @param known  for laws that weigh
/// @return no answer: the last valid torque is held, nothing else changes but where the next search
/// for x̂ starts; near_singular: the torque is that of the damped J
Outcome control(const Robot& robot, const ControlSettings& settings, const Setpoint& setpoint,
                const Extended& q_e, ControlState& state, const Weighing& known = {});

/// PD gains by pole placement: a second-order response of that natural frequency (rad/s) and
/// damping ratio. Diagonal gains give it to motor i alone, held at pose x; gains shaped by the
/// inertia to every motor at every pose, and x must only be valid.
Outcome place_poles(const Robot& robot, const Coordinates& x, Real frequency, Real damping,
                    ControlSettings& settings);
}  // namespace truepose
