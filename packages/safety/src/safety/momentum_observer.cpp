// Observer of the generalised momentum: external forces, and what causes them.
#include "safety/momentum_observer.hpp"

namespace truepose::momentum_detail {
void filter(Real gain, const Joint& input, Joint& once, Joint& twice) {
  for (std::size_t i = 0; i < input.size(); ++i) {
    once[i] += gain * (input[i] - once[i]);
    twice[i] += gain * (once[i] - twice[i]);
  }
}

Coordinates carried(const Robot& robot, const Closure& closure, const Coordinates& rate,
                    const Coordinates& acceleration) {
  const Twist twist = to_twist(closure.carried, acceleration);
  const Vec3 force = twist.velocity + drifting(closure.carried, rate).velocity - robot.gravity;
  Coordinates columns;
  free_row(closure.carried, force, Vec3::Zero(), columns.data());
  return columns;
}

Closure closed(const Robot& robot, const MomentumObserver& state) {
  Closure closure;
  closure.pose = state.before;
  closure.motors = robot.motors;
  carry(robot, state.before, closure.carried);
  std::copy_n(state.chain.begin(), robot.motors, closure.chain.begin());
  return closure;
}

Outcome update_residual(const Robot& robot, const MomentumSettings& settings,
                        MomentumObserver& state) {
  const int n = dof(robot.mobility), m = robot.motors;
  const Closure closure = closed(robot, state);
  Jacobians jacobians;
  const Outcome outcome = jacobian(closure, jacobians);
  if (!outcome) return outcome;
  const Joint rate = jacobians.joint_rate(state.rate);
  const Real gain = std::min<Real>(1, settings.bandwidth * settings.period);
  const Real slow = settings.period * settings.bandwidth * 0.1;
  Joint slope{};
  for (int i = 0; i < m; ++i) slope[i] = 1 / closure.chain[i].rate;
  // Kᵀ τ, the force of motor torques on the platform.
  const auto force_of = [&](const Joint& torque) {
    Coordinates force{};
    for (int i = 0; i < m; ++i) {
      const Real per_jq = torque[i] * closure.chain[i].rate / jacobians.jq[i];
      for (int j = 0; j < n; ++j) force[j] += jacobians.jx[i][j] * per_jq;
    }
    return force;
  };
  Joint held = state.held, residual = motor_torques(n, m, jacobians.J, state.needed, slope);
  for (int i = 0; i < m; ++i) held[i] -= friction(robot.chain[i], rate[i] * closure.chain[i].rate);
  // Torques that only stress the robot are no disturbance.
  if (m > n) held = motor_torques(n, m, jacobians.J, force_of(held), slope);
  for (int i = 0; i < m; ++i) {
    const Real turns = rate[i] * closure.chain[i].rate;
    residual[i] -= held[i];
    state.sign[0][i] = -std::clamp<Real>(turns / slow, -1, 1);  // unknown within its counts
  }
  if (!all_finite(residual, m)) return {Status::not_finite, -1};
  for (int i = 0; i < m; ++i) slope[i] = -slope[i];
  state.mass[0] = motor_torques(n, m, jacobians.J,
                                carried(robot, closure, state.rate, state.acceleration), slope);
  filter(gain, residual, state.once, state.residual);
  state.force = force_of(state.residual);
  return outcome;
}

void name(const Robot& robot, const MomentumSettings& settings, MomentumObserver& state) {
  const int n = dof(robot.mobility), m = robot.motors;
  const Real gain = std::min<Real>(1, settings.bandwidth * settings.period);
  filter(gain, state.mass[0], state.mass[1], state.mass[2]);
  filter(gain, state.sign[0], state.sign[1], state.sign[2]);
  const Joint &mass = state.mass[2], &sign = state.sign[2];
  Joint weight{};  // V⁻¹
  state.chi2 = 0;
  for (int i = 0; i < m; ++i) {
    const Real sigma = settings.sigma[i], share = settings.share * state.torque[i];
    weight[i] = 1 / (sigma * sigma + share * share);
    state.chi2 += state.residual[i] * state.residual[i] * weight[i];
  }
  constexpr int kLong = 1 << 30;  // cycles: a payload may be carried for months
  state.quiet = state.chi2 < settings.alarm / 4 ? std::min(state.quiet + 1, kLong) : 0;
  if (state.since == 0 ? state.chi2 < settings.alarm
                       : state.quiet * settings.period > settings.over) {
    if (state.since > 0) {
      state.payload = {};
      state.friction.fill({});
      state.energy.fill(0);
      state.count = state.size = state.sigma = state.largest = 0;
      state.disturbance = Disturbance::none;
      state.motor = -1;
      state.since = 0;
    }
    return;
  }
  constexpr Real kSettled = 4;  // time constants of the filter
  state.since = std::min(state.since + 1, kLong);
  Real square = 0;
  for (int i = 0; i < n; ++i) square += state.force[i] * state.force[i];
  state.largest = std::max(state.largest, std::sqrt(square));
  if (state.since * gain < kSettled) return;
  const Real keep = 1 - settings.period / settings.window;
  state.count = keep * state.count + 1;
  state.payload.information *= keep;
  state.payload.score *= keep;
  Real whole = 0;
  Cause every;  // the same friction of all motors, dry joints or cold grease, is one cause
  for (int i = 0; i < m; ++i) {
    Cause& cause = state.friction[i];
    cause.information *= keep;
    cause.score *= keep;
    state.energy[i] *= keep;
    // A motor at rest rubs with anything up to its friction: that tells no cause from another.
    const Real w = weight[i], rho = state.residual[i];
    const bool rubs = state.disturbance == Disturbance::friction && std::fabs(sign[i]) < kRests &&
                      std::fabs(rho) < kSticks * state.size;
    if (rubs) continue;
    state.payload.information += mass[i] * w * mass[i];
    state.payload.score += mass[i] * w * rho;
    cause.information += sign[i] * w * sign[i];
    cause.score += sign[i] * w * rho;
    state.energy[i] += rho * w * rho;
  }
  for (int i = 0; i < m; ++i) {
    every.information += state.friction[i].information;
    every.score += state.friction[i].score;
    whole += state.energy[i];
  }
  Disturbance found = Disturbance::payload;
  const Cause* of = &state.payload;
  int motor = -1;
  Real most = of->accounts();
  // A motor at rest may rub with less than its friction, in either direction: all of its residual
  // counts as friction's, as soon as any is against motion.
  for (int i = 0; i < m; ++i)
    if (state.friction[i].score > 0 && state.energy[i] > most) {
      most = state.energy[i];
      found = Disturbance::friction;
      of = &state.friction[i];
      motor = i;
    }
  const bool all = every.accounts() > most;
  if (all) {
    most = every.accounts();
    found = Disturbance::friction;
    of = &every;
    motor = -1;
  }
  const bool same = found == state.disturbance && motor == state.motor;
  if (most > (same ? settings.kept : settings.named) * whole) {
    state.disturbance = found;
    state.motor = motor;
    state.size = of->score / of->information;
    // Errors of torque, masses and friction are systematic: more samples do not reduce them.
    state.sigma = std::sqrt(state.count / of->information);
  } else if (state.since * settings.period > settings.over + kSettled / settings.bandwidth) {
    state.disturbance = Disturbance::contact;
    state.motor = -1;
    state.size = state.largest;
    state.sigma = 0;
  }
}

}  // namespace truepose::momentum_detail

namespace truepose {
void sample_momentum(const Robot& robot, const MomentumSettings& settings, const Pose& pose,
                     const Joint& torque, MomentumObserver& state) {
  if (!(settings.period > 0 && settings.sigma[0] > 0)) return;
  const Coordinates motion =
      state.cycles > 0 ? difference(robot.mobility, pose, state.pose) : Coordinates{};
  if (state.cycles < 2) {
    ++state.cycles;
  } else {
    state.step = 1;
    state.before = state.pose;
    const Real per = 1 / settings.period;
    for (int i = 0; i < dof(robot.mobility); ++i) {
      state.rate[i] = 0.5 * per * (motion[i] + state.motion[i]);
      state.acceleration[i] = per * per * (motion[i] - state.motion[i]);
    }
    for (int i = 0; i < robot.motors; ++i) state.held[i] = 0.5 * (state.torque[i] + torque[i]);
  }
  state.pose = pose;
  state.motion = motion;
  state.torque = torque;
}

Outcome observe_momentum(const Robot& robot, const MomentumSettings& settings,
                         MomentumObserver& state) {
  Outcome outcome;
  if (state.step == 0) return outcome;
  switch (state.step++) {
    case 1: {
      Closure closure;
      outcome = ikm(robot, state.before, closure, false);
      std::copy_n(closure.chain.begin(), robot.motors, state.chain.begin());
      break;
    }
    case 2: {
      DynamicModel model;
      const Closure closure = momentum_detail::closed(robot, state);
      outcome = dynamic_model(robot, closure, state.rate, model, &state.acceleration);
      std::copy_n(model.bias.begin(), dof(robot.mobility), state.needed.begin());
      break;
    }
    case 3: outcome = momentum_detail::update_residual(robot, settings, state); break;
    default: state.step = 0; momentum_detail::name(robot, settings, state);
  }
  if (!outcome) state.cycles = state.step = 0;
  return outcome;
}

void add_payload_torque(const Robot& robot, const MomentumSettings& settings,
                        const Setpoint& setpoint, MomentumObserver& state, Joint& torque) {
  const int n = dof(robot.mobility), m = robot.motors;
  state.refused = false;
  if (!settings.carry || state.disturbance != Disturbance::payload) return;
  Closure closure;
  Jacobians jacobians;
  DynamicModel model;
  Outcome outcome = ikm(robot, to_pose(robot.mobility, setpoint.x), closure, false);
  if (outcome) outcome = jacobian(closure, jacobians);
  if (outcome) outcome = dynamic_model(robot, closure, Coordinates{}, model);
  if (!outcome) return;
  const Joint own = inverse_dynamics(model, jacobians.J, Coordinates{});
  const auto torques = [&](const Coordinates& rate, const Coordinates& acceleration) {
    return motor_torques(n, m, jacobians.J,
                         momentum_detail::carried(robot, closure, rate, acceleration), model.slope);
  };
  const Joint held = torques({}, {});
  const Joint more = torques(setpoint.rate, setpoint.acceleration);
  for (int i = 0; i < m; ++i) {
    const Real most = robot.chain[i].torque_limit;
    if (!std::isfinite(state.size * (std::fabs(held[i]) + std::fabs(more[i]))))
      state.refused = true;
    if (most > 0 && !(std::fabs(own[i] + state.size * held[i]) < most)) state.refused = true;
  }
  for (int i = 0; i < m && !state.refused; ++i)
    torque[i] = limited(robot.chain[i], torque[i] + state.size * more[i]);
}

void observe_forces(const Robot& robot, const MomentumSettings& settings, Real period, bool moves,
                    const Joint& torque, FaultMonitor& monitor, MomentumObserver& state) {
  const int n = robot.motors;
  bool observed = moves;
  for (int i = 0; i < n; ++i) observed = observed && monitor.reading[i].health == Health::valid;
  if (!observed) {
    state = {};
  } else {  // the observer takes several periods as one, and works in each of them
    const Real several = settings.period / period;
    const int every = several > 1 && several < 100 ? static_cast<int>(several + Real(0.5)) : 1;
    for (int i = 0; i < n; ++i) state.sum[i] += torque[i];
    if (++state.waited >= every) {
      Joint mean{};
      for (int i = 0; i < n; ++i) mean[i] = state.sum[i] / static_cast<Real>(every);
      state.sum = {};
      state.waited = 0;
      sample_momentum(robot, settings, monitor.pose, mean, state);
    }
    for (int done = 0; done < kMomentumSteps; done += every)
      static_cast<void>(observe_momentum(robot, settings, state));
  }
  for (int i = 0; i < n; ++i) monitor.pushed[i] = std::fabs(state.residual[i]) * settings.give[i];
}
}  // namespace truepose
