// Settings of the momentum observer from a robot and its controller.
#include "safety/momentum_defaults.hpp"

namespace truepose {
Outcome default_momentum(const Robot& robot, const ControlSettings& settings,
                         MomentumSettings& momentum) {
  momentum = {};
  momentum.period = 0;
  AtRest home;
  const Outcome outcome = home.find(robot, to_pose(robot.mobility, robot.home));
  if (!outcome) return outcome;
  for (int i = 0; i < robot.motors; ++i) {
    const Chain& chain = robot.chain[i];
    const Real inertia = std::fabs(home.model.slope[i]) * home.inertia[i][i];
    const Real kp = std::fabs(settings.kp[i]) * (settings.gains == Gains::inertia ? inertia : 1);
    if (!(chain.torque_limit > 0 && kp > 0)) return Outcome{Status::no_such_value, i};
    const Real noise = chain.encoder_noise, step = chain.encoder_step;  // no hypot: glibc 2.35
    const Real counts = inertia * momentum.bandwidth * momentum.bandwidth *
                        std::sqrt(noise * noise + step * step / 12);
    const Real friction = Real(0.01) * chain.torque_limit;
    momentum.sigma[i] = std::sqrt(friction * friction + counts * counts);
    momentum.give[i] = 1 / kp;
  }
  momentum.period = std::max<Real>(1, std::round(Real(0.004) / settings.period)) * settings.period;
  return outcome;
}
}  // namespace truepose
