// Where does a robot come to rest under a controller? Exactly, without simulating the motion.
#pragma once

#include <optional>

#include "truepose/control/control.hpp"
#include "truepose/offline/faults.hpp"
#include "truepose/offline/plant.hpp"

namespace truepose {

/// At rest the torques balance: kp ê_q + τ_ff(x_d) = τ_hold(x), nominal feed-forward against the
/// true robot's weight; gains shaped by the inertia push by M_q(x_d) kp ê_q. Without gravity, or
/// with integral action, this is ê_q = 0.
struct StaticsSettings {
  ControlSettings control;
  bool gravity = false;  ///< false: ê_q = 0
};

inline constexpr int kSettleIterations = 100;
inline constexpr double kMostAmplified = 100;  ///< by faulty readings, of what still settles

/// Pose where the true robot settles when the nominal controller is asked for x_d. Quasi-Newton
/// on the motor error with the nominal J: each step removes all but the few per cent by which the
/// true robot's J differs. Unquantised readings.
/// @param x         out
/// @param weighing  of the nominal robot, for laws that weigh
/// @param off       by which readings are off, as by the play of a gear
/// @param faults    of readings that lie; not_converged where the robot would run away
/// @param by_truth  out: whether it was the true robot, not the law, that had no answer
template <Mobility K>
inline Outcome settle(const Robot& nominal, const Robot& truth, const StaticsSettings& settings,
                      const Coordinates& x_d, Coordinates& x, const Weighing& weighing = {},
                      const Extended& off = {}, bool* by_truth = nullptr,
                      FaultyReadings* faults = nullptr) {
  constexpr int n = kDof<K>;
  const Law law = settings.control.law;
  Reference<K> reference;
  Parasitic nearby, standing;  // what the full level adds at x_d, and where the true robot stands
  Outcome outcome =
      refer<K>(nominal, law, x_d, reference, settings.control.damped_below, weighing, &nearby);
  if (!outcome) return outcome;
  const Outcome regular = outcome;
  const auto hold = [](const Robot& robot, const Closure<K>& closure,
                       const Matrix<kDof<K>, kDof<K>>& J, DynamicModel<K>& model, Joint& torque) {
    const Outcome result = dynamic_model<K>(robot, closure, Coordinates{}, model);
    if (result) torque = inverse_dynamics<K>(model, J, Coordinates{});
    return result;
  };
  Joint feed{};
  DynamicModel<K> model;  // of the nominal robot at x_d
  if (settings.gravity)
    outcome = hold(nominal, reference.closure, reference.jacobians.J, model, feed);
  if (!outcome) return outcome;
  if (settings.control.feed_forward == FeedForward::none) feed = {};
  std::optional<Ldlt<n>> inertia;
  if (settings.gravity && settings.control.gains == Gains::inertia) {
    const Matrix<n, n> M_q = joint_inertia<K>(model, reference.jacobians.J);
    std::array<double, n> size;
    for (int i = 0; i < n; ++i) size[i] = M_q[i][i];
    inertia.emplace(M_q, size);
    if (!inertia->regular()) return {Status::singular, -1};
  }

  Pose pose = reference.closure.pose;
  double last = INFINITY;
  // The steps are the robot's own way to its rest, and end where it does: a fault that turns the
  // loop's feedback round has no rest. One that overstates the motion must not overshoot.
  const double most = faults ? std::min(faults->amplification(), kMostAmplified) : 1;
  const int iterations = static_cast<int>(most * kSettleIterations);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Closure<K> closure;
    Extended q_e{};
    outcome = exact_readings<K>(truth, pose, q_e, standing);
    if (outcome && settings.gravity) outcome = ikm<K>(truth, pose, closure);
    if (by_truth) *by_truth = !outcome;
    if (!outcome) return outcome;
    for (int c = 0; c < n + truth.r; ++c) q_e[c] += off[c];
    if (faults) faults->read(0, q_e);
    Joint error{};
    Pose found;
    outcome = motor_error<K>(nominal, law, reference, q_e, error, found, weighing, nearby);
    if (!outcome) return outcome;
    if (settings.gravity) {
      Jacobians<K> jacobians;
      Joint load{};
      outcome = jacobian<K>(closure, jacobians);
      DynamicModel<K> loaded;
      if (outcome) outcome = hold(truth, closure, jacobians.J, loaded, load);
      if (!outcome) return outcome;
      std::array<double, n> lack;
      for (int i = 0; i < n; ++i) lack[i] = feed[i] - load[i];
      if (inertia) {
        for (int i = 0; i < n; ++i) lack[i] /= model.slope[i];
        inertia->solve(lack);
      }
      for (int i = 0; i < n; ++i) error[i] += lack[i] / settings.control.kp[i];
    }
    Coordinates step{};
    double size = 0;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) step[i] += reference.jacobians.J[i][j] * error[j] / most;
      size = std::max(size, std::fabs(step[i]));
    }
    if (!all_finite(step, n)) return {Status::not_finite, -1};
    pose = moved<K>(pose, step);
    // Linear convergence: stop at rounding, or where steps of that size no longer shrink.
    if (size < 1e-14 || (size < 1e-12 && size >= last)) {
      x = to_coordinates<K>(pose);
      return regular;
    }
    last = size;
  }
  return {Status::not_converged, -1};
}

/// How an error of one reading leaks into the pose at which a robot without other errors rests:
/// δx = leakage δq_e, n×(n + r), to first order; δx along the free twist.
///
/// At rest ê_q(x_d, q_e) = 0, and every law sees the joint error in readings that agree,
/// ∂ê_q/∂q_e H_x = -J⁻¹. With q_e = h(x) + δq_e therefore δx = J ∂ê_q/∂q_e δq_e: -[J 0] under the
/// joint law, -J M⁺ under a TEJ, -∂x̂/∂q_e under a law of the pose. For `estimated` that is the
/// gain of the fused readings, J times the weighted TEJ: both laws leak alike.
template <Mobility K>
inline Outcome leakage(const Robot& robot, Law law, const Coordinates& x, PoseColumns& leak,
                       const Weighing& weighing = {}) {
  constexpr int n = kDof<K>;
  constexpr double kStep = 1e-6;  // rad or m, of the closed FKM's central difference
  Reference<K> reference;
  const Outcome outcome =
      refer<K>(robot, law == Law::estimated ? Law::weighted : law, x, reference, 0, weighing);
  if (!outcome) return outcome;
  leak = {};
  const bool of_pose = properties(law).corrects == Corrects::pose && law != Law::estimated;
  for (int c = 0; c < n + robot.r; ++c) {
    if (of_pose) {
      Coordinates change[2];
      for (const double side : {-1.0, 1.0}) {
        Extended q_e{};
        q_e = reference.q_e;
        q_e[c] += side * kStep;
        Pose found;
        const Outcome there =
            found_pose<K>(robot, law, reference.closure.pose, q_e, found, weighing);
        if (!there) return there;
        change[side > 0] = difference<K>(found, reference.pose);
      }
      for (int i = 0; i < n; ++i) leak[i][c] = (change[0][i] - change[1][i]) / (2 * kStep);
    } else if (properties(law).corrects == Corrects::motors) {
      for (int i = 0; i < n && c < n; ++i) leak[i][c] = -reference.jacobians.J[i][c];
    } else {
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) leak[i][c] -= reference.jacobians.J[i][j] * reference.tej[j][c];
    }
  }
  return {};
}

}  // namespace truepose
