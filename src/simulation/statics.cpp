// Static equilibrium under a controller, without simulation of the motion.
#include "simulation/statics.hpp"

#include "calibration/dense.hpp"

namespace truepose {
namespace {
constexpr int kSettleIterations = 100;
constexpr double kMostAmplified = 100;  // largest fault gain at a stable equilibrium

/// A PD controller at x_d under load: feed-forward, compliance, and the load's change.
class Loaded {
 public:
  /// @return singular, or the outcome of a failed nominal model
  Outcome set(const Robot& nominal, const ControlSettings& settings, const Reference& reference) {
    const auto& J = reference.jacobians.J;
    m = nominal.motors;
    const int n = dof(nominal.mobility);
    DynamicModel model;
    const Outcome outcome = dynamic_model(nominal, reference.closure, Coordinates{}, model);
    if (!outcome) return outcome;
    if (settings.feed_forward != FeedForward::none)
      feed_ = inverse_dynamics(model, J, Coordinates{});
    RowMatrix stiffness(m, m), K(m, n);
    const auto M_q = joint_inertia(model, J);
    for (int i : range(m)) std::ranges::copy_n(reference.jacobians.jx[i].begin(), n, K[i]);
    for (int i : range(m))
      for (int j : range(n)) K(i, j) /= reference.jacobians.jq[i];
    for (int i : range(m))
      for (int j : range(m))
        if (settings.gains == Gains::inertia)
          stiffness(i, j) = model.slope[i] * M_q[i][j] * settings.kp[j];
        else if (i == j)
          stiffness(i, i) = settings.kp[i];
    yield_ = singular_values(stiffness).inverse();
    if (m > n)  // of the platform: torques that only stress it move nothing
      yield_ = K * (singular_values(transposed(K) * (stiffness * K)).inverse() * transposed(K));
    RowMatrix follows(m, m);  // ∂τ_hold/∂q
    constexpr double kStep = 1e-5;
    for (int j : range(m)) {
      Joint torque[2];
      bool both = true;
      for (const double side : {-1.0, 1.0}) {
        Coordinates step{};
        for (int i : range(n)) step[i] = side * kStep * J[i][j];
        both = hold(nominal, moved(nominal.mobility, reference.closure.pose, step),
                    torque[side > 0]) &&
               both;
      }
      for (int i : range(m))  // at the edge of the workspace: 0
        follows(i, j) = both ? (torque[1][i] - torque[0][i]) / (2 * kStep) : 0;
    }
    newton_ = singular_values(sum(RowMatrix::identity(m), yield_ * follows)).inverse();
    return {};
  }

  /// Replaces ê_q by the motors' step that balances ê_q + kp⁻¹ (τ_ff - τ_hold).
  void relieve(const Joint& load, Joint& error) const {
    std::vector<double> lack(m);
    for (int i : range(m)) lack[i] = feed_[i] - load[i];
    lack = yield_ * lack;
    for (int i : range(m)) lack[i] += error[i];
    std::ranges::copy(newton_ * lack, error.begin());
  }

 private:
  int m = 0;
  Joint feed_{};
  RowMatrix yield_, newton_;
};
}  // namespace

Outcome settle(const Robot& nominal, const Robot& truth, const StaticsSettings& settings,
               const Coordinates& x_d, Coordinates& x, const Weighing& known, const Extended& off,
               bool* by_truth, FaultyReadings* faults) {
  const int n = dof(nominal.mobility);
  const Law law = settings.control.law;
  const Scaled scaled(known, settings.control.sigma_scale);
  const Weighing& weighing = scaled.weighing;
  Reference reference;
  Parasitic nearby, standing;  // full-level state at x_d, and at the true robot's pose
  Outcome outcome =
      refer(nominal, law, x_d, reference, settings.control.damped_below, weighing, &nearby);
  if (!outcome) return outcome;
  const Outcome regular = outcome;
  Loaded loaded;
  if (settings.gravity) outcome = loaded.set(nominal, settings.control, reference);
  if (!outcome) return outcome;

  Pose pose = reference.closure.pose;
  double last = INFINITY;
  // The steps follow the robot's own approach, so a fault that reverses the feedback has no
  // equilibrium. One that overstates the motion must not overshoot.
  const double most = faults ? min(faults->amplification(), kMostAmplified) : 1;
  const int iterations = int(most * kSettleIterations);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Extended q_e{};
    Joint load{};
    outcome = extended(level_of(truth), truth, pose, q_e, &standing);
    if (outcome && settings.gravity) outcome = hold(truth, pose, load);
    if (by_truth) *by_truth = !outcome;
    if (!outcome) return outcome;
    for (int c : range(readings(truth))) q_e[c] += off[c];
    if (faults) faults->make_faulty(0, q_e);
    Joint error{};
    Pose found;
    outcome = motor_error(nominal, law, reference, q_e, error, found, weighing);
    if (!outcome) return outcome;
    if (settings.gravity) loaded.relieve(load, error);
    Coordinates step{};
    double size = 0;
    for (int i : range(n)) {
      for (int j : range(nominal.motors)) step[i] += reference.jacobians.J[i][j] * error[j] / most;
      size = max(size, fabs(step[i]));
    }
    if (!all_finite(step, n)) return Status::not_finite;
    pose = moved(nominal.mobility, pose, step);
    // Linear convergence: stop at rounding, or where small steps no longer shrink.
    if (size < 1e-14 || (size < 1e-12 && size >= last)) {
      x = to_coordinates(nominal.mobility, pose);
      return regular;
    }
    last = size;
  }
  return Status::not_converged;
}

Outcome leakage(const Robot& robot, Law law, const Coordinates& x, PoseColumns& leak,
                const Weighing& weighing) {
  constexpr double kStep = 1e-6;  // rad or m, of the central difference
  Reference reference;
  if (law == Law::estimated) law = Law::weighted;
  const Outcome outcome = refer(robot, law, x, reference, 0, weighing);
  if (!outcome) return outcome;
  leak = {};
  for (int c : range(readings(robot)))
    for (const double side : {-1.0, 1.0}) {
      Extended q_e = reference.q_e;
      q_e[c] += side * kStep;
      Pose found;
      Joint error{};
      const Outcome there = motor_error(robot, law, reference, q_e, error, found, weighing);
      if (!there) return there;
      for (int i : range(dof(robot.mobility)))
        for (int j : range(robot.motors))
          leak[i][c] += reference.jacobians.J[i][j] * error[j] * side / (2 * kStep);
    }
  return {};
}
}  // namespace truepose
