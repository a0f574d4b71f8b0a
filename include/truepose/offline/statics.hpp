// Where does a robot come to rest under a controller? Exactly, without simulating the motion.
#pragma once

#include "truepose/control.hpp"

namespace truepose {

/// At rest the torques balance: kp ê_q + τ_ff(x_d) = τ_hold(x), nominal feed-forward against the
/// true robot's weight. Without gravity, or with integral action, this is ê_q = 0.
struct StaticsSettings {
  ControlSettings control;
  bool gravity = false;  ///< false: ê_q = 0
};

inline constexpr int kSettleIterations = 100;

/// Pose where the true robot settles when the nominal controller is asked for x_d. Quasi-Newton
/// on the motor error with the nominal J: each step removes all but the few per cent by which the
/// true robot's J differs. Unquantised readings.
/// @param x  out
template <Mobility K>
inline Outcome settle(const Robot& nominal, const Robot& truth, const StaticsSettings& settings,
                      const Joint& x_d, Joint& x) {
  constexpr int n = kDof<K>;
  const Law law = settings.control.law;
  Reference<K> reference;
  Outcome outcome = refer<K>(nominal, law, x_d, reference, settings.control.damped_below);
  if (!outcome) return outcome;
  const Outcome regular = outcome;
  const auto hold = [](const Robot& robot, const Closure<K>& closure,
                       const Matrix<kDof<K>, kDof<K>>& J, Joint& torque) {
    DynamicModel<K> model;
    const Outcome result = dynamic_model<K>(robot, closure, Joint{}, model);
    if (result) torque = inverse_dynamics<K>(model, J, Joint{});
    return result;
  };
  Joint feed{};
  if (settings.gravity && settings.control.feed_forward != FeedForward::none)
    outcome = hold(nominal, reference.closure, reference.jacobians.J, feed);
  if (!outcome) return outcome;

  Pose pose = reference.closure.pose;
  double last = INFINITY;
  for (int iteration = 0; iteration < kSettleIterations; ++iteration) {
    Closure<K> closure;
    outcome = ikm<K>(truth, pose, closure);
    Extended q_e{};
    Reading r;
    Matrix<kMaxSensors, kDof<K>> jr;
    if (outcome) outcome = rkm<K>(truth, closure, r, jr);
    if (!outcome) return outcome;
    for (int i = 0; i < n; ++i) q_e[i] = closure.chain[i].q;
    for (int k = 0; k < truth.r; ++k) q_e[n + k] = r[k];
    Joint error{};
    Pose estimate;
    outcome = motor_error<K>(nominal, law, reference, q_e, error, estimate);
    if (!outcome) return outcome;
    if (settings.gravity) {
      Jacobians<K> jacobians;
      Joint load{};
      outcome = jacobian<K>(closure, jacobians);
      if (outcome) outcome = hold(truth, closure, jacobians.J, load);
      if (!outcome) return outcome;
      for (int i = 0; i < n; ++i) error[i] += (feed[i] - load[i]) / settings.control.kp[i];
    }
    Joint step{};
    double size = 0;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) step[i] += reference.jacobians.J[i][j] * error[j];
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
  return {Status::unreachable, -1};
}

}  // namespace truepose
