#include "control/control.hpp"

namespace truepose {
void track(const ControlSettings& settings, Real pole, Real reading, Real expected, Real& position,
           Real& rate) {
  const Real predicted = position + settings.period * (expected - rate);
  const Real innovation = reading - predicted;
  position = predicted + (1 - pole * pole) * innovation;
  rate -= (1 - pole) * (1 - pole) / settings.period * innovation;
}

Extended in_terms_of(Corrects corrects, const Joint& rate, const Reference& reference, int r) {
  const int n = reference.jacobians.n;
  Extended result{};
  std::copy_n(rate.begin(), n, result.begin());
  const Coordinates twist = pose_rate(reference.jacobians, rate);
  if (corrects == Corrects::pose) std::copy_n(twist.begin(), n, result.begin());
  if (corrects == Corrects::readings)
    for (int k = 0; k < r; ++k)
      for (int i = 0; i < n; ++i) result[n + k] += reference.jr[k][i] * twist[i];
  return result;
}

Outcome place_poles(const Robot& robot, const Coordinates& x, Real frequency, Real damping,
                    ControlSettings& settings) {
  const int n = dof(robot.mobility);
  Closure closure;
  Jacobians jacobians;
  DynamicModel model;
  Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  if (outcome) outcome = jacobian(closure, jacobians);
  if (outcome) outcome = dynamic_model(robot, closure, Coordinates{}, model);
  if (!outcome) return outcome;
  const auto inertia = joint_inertia(model, jacobians.J);
  for (int m = 0; m < n; ++m) {
    // The error is in readings, the torque is the motor's own.
    const Real of = settings.gains == Gains::inertia ? 1 : model.slope[m] * inertia[m][m];
    settings.kp[m] = of * frequency * frequency;
    settings.kd[m] = 2 * damping * of * frequency;
  }
  if (!all_finite(settings.kp, n) || !all_finite(settings.kd, n))
    outcome = {Status::not_finite, -1};
  return outcome;
}
}  // namespace truepose
