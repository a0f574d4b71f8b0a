// Observer of the generalised momentum: external forces, and what causes them.
//
// For the momentum p = M(x) ẋ of the platform's coordinates (dynamics.hpp)
//
//     ṗ = Kᵀ (τ - friction) - c + Ṁ ẋ + f,
//
// f an external force. The observer filters its residual by (L/(s + L))², so no acceleration is
// needed: at the latest but one pose, M (v⁺ - v⁻)/T with the mean velocities of the periods before
// and after it is ṗ - Ṁ ẋ, and differences of noise telescope in the filter. Torques are those held
// in these periods. (De Luca, Albu-Schäffer, Haddadin and Hirzinger, Collision detection and safe
// reaction with the DLR-III lightweight manipulator arm, 2006, for serial robots.)
//
// The work on a sample is done in four steps, one in a control cycle.
//
// The residual is kept in motor torques, ρ = Jᵀ f, where its σ is known: unknown friction, an error
// of torque and masses, counts. One unknown cause accounts for (ΣφᵀV⁻¹ρ)²/ΣφᵀV⁻¹φ of ΣρᵀV⁻¹ρ, φ its
// effect through the same filter: a mass at D, -Jᵀ (a_D - g), or friction of motor i, -sign(q̇_i),
// or of all. A cause that accounts for nearly all is named; otherwise it is a contact.
#pragma once

#include <algorithm>

#include "control/supervisor.hpp"
#include "truepose_safety.h"

namespace truepose {
/// Constant during a run. The defaults are assumed; a healthy robot stays below `alarm`.
struct MomentumSettings {
  std::uint32_t size = sizeof(truepose_momentum_settings);  ///< for the C interface
  int carry = false;    ///< 1: feeds an identified payload forward
  Real period = 1e-3;   ///< s, of one or several control periods; 0: no observer
  Real bandwidth = 60;  ///< L, rad/s
  Real alarm = 25;      ///< χ² of the residual above which there is a disturbance
  Real share = 0.05;    ///< σ of masses and torques, as a share of the torque
  Real named = 0.85;    ///< share of the residual that a named cause accounts for
  Real kept = 0.6;      ///< the same for a cause that is already named
  Real window = 0.3;    ///< time constant with which older samples are forgotten, s
  Real over = 0.1;      ///< time below a quarter of `alarm` after which a disturbance is over, s
  Joint sigma{};        ///< σ of unknown friction and counts, N·m or N; 0: no observer
  Joint give{};         ///< error at which a motor's loop balances 1 N·m (N), rad or m
};

/// Sums of the residual's regression on one unknown cause.
struct Cause {
  Real information = 0;  ///< Σ φᵀV⁻¹φ
  Real score = 0;        ///< Σ φᵀV⁻¹ρ

  /// What it accounts for of Σ ρᵀV⁻¹ρ. A mass and friction are not negative.
  Real accounts() const { return score > 0 ? score * score / information : 0; }
};

/// Filtered sign of a motor's motion below which it rests, and friction of such a motor over the
/// named one.
inline constexpr Real kRests = 0.5, kSticks = 1.5;
inline constexpr int kMomentumSteps = 4;  ///< in which the work on a sample is done

/// State and report. Plain data, the caller's; a new one starts afresh.
struct MomentumObserver : DisturbanceReport {
  int cycles = 0;        ///< sampled, saturated
  Joint sum{};           ///< torques of the period so far,
  int waited = 0;        ///< and its control cycles
  Pose pose;             ///< the latest sample,
  Coordinates motion{};  ///< the motion to it,
  Joint torque{};        ///< and the torque applied before it

  int step = 0;  ///< the next of the work on the sample before it; 0: done
  Pose before;   ///< that sample's pose,
  Coordinates rate{}, acceleration{};
  Joint held{};                                ///< torque around it,
  std::array<ChainState, kMaxMotors> chain{};  ///< its closed chains,
  Coordinates needed{};                        ///< and the force M ẍ + c

  Joint once{}, residual{};     ///< ρ, filtered once and twice
  std::array<Joint, 3> mass{};  ///< φ of a mass: unfiltered, filtered once and twice
  std::array<Joint, 3> sign{};  ///< and of friction
  Cause payload;
  std::array<Cause, kMaxMotors> friction;
  Joint energy{};    ///< Σ ρᵀV⁻¹ρ, each motor's part
  Real count = 0;    ///< of samples in the sums
  int since = 0;     ///< samples since the disturbance began; 0: none
  Real largest = 0;  ///< norm of the force since the disturbance began
  int quiet = 0;     ///< samples below a quarter of `alarm`
};

namespace momentum_detail {
/// Two first-order low-passes. @param gain  L T
void filter(Real gain, const Joint& input, Joint& once, Joint& twice);

/// Force of the platform's coordinates for a mass of 1 kg at D. @param acceleration  ẍ
Coordinates carried(const Robot& robot, const Closure& closure, const Coordinates& rate,
                    const Coordinates& acceleration);

/// The sample's closed chains.
Closure closed(const Robot& robot, const MomentumObserver& state);

/// ρ and the force f, filtered; φ.
Outcome update_residual(const Robot& robot, const MomentumSettings& settings,
                        MomentumObserver& state);

/// Filters φ and names the disturbance, from its start until it is over.
void name(const Robot& robot, const MomentumSettings& settings, MomentumObserver& state);
}  // namespace momentum_detail

/// Takes a sample, after whose steps the report is of the sample before it.
/// @param pose    given by the believed motors
/// @param torque  applied since the last sample, mean
void sample_momentum(const Robot& robot, const MomentumSettings& settings, const Pose& pose,
                     const Joint& torque, MomentumObserver& state);

/// Does the next step of the work on a sample, if any is left. Bounded; a failure changes nothing
/// but the start.
Outcome observe_momentum(const Robot& robot, const MomentumSettings& settings,
                         MomentumObserver& state);

/// Adds the torques of an identified payload along the setpoint. If the motors cannot hold its
/// weight and the robot's, nothing is added and `refused` is set.
void add_payload_torque(const Robot& robot, const MomentumSettings& settings,
                        const Setpoint& setpoint, MomentumObserver& state, Joint& torque);

/// Observes forces after monitor_faults(), while every motor is read and no brake acts.
/// @param torque  applied in the last control period
void observe_forces(const Robot& robot, const MomentumSettings& settings, Real period, bool moves,
                    const Joint& torque, FaultMonitor& monitor, MomentumObserver& state);

/// The observer in the fault-tolerant controller. Its functions are inline: the library, compiled
/// without type information, has none of its own of this class.
struct MomentumSupervisor final : Supervisor {
  MomentumSettings settings;
  MomentumObserver state;

  explicit MomentumSupervisor(const MomentumSettings& of = {}) : settings(of) {}
  void observe(const Robot& robot, Real period, bool moves, const Joint& torque,
               FaultMonitor& monitor) TRUEPOSE_BOUNDED override {
    observe_forces(robot, settings, period, moves, torque, monitor, state);
  }
  void answered(const Robot& robot, const Setpoint& setpoint,
                Joint& torque) TRUEPOSE_BOUNDED override {
    add_payload_torque(robot, settings, setpoint, state, torque);
  }
  const DisturbanceReport& disturbance() const TRUEPOSE_BOUNDED override { return state; }
};
}  // namespace truepose
