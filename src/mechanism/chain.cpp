// Loop closure of one chain: from the motor to B, and from the platform to the motor.
#include "mechanism/chain.hpp"

namespace truepose {
Encoded encode(const Chain& chain, Real position) {
  // Beyond the turning point of the slide in v no v exists: the root is kept above zero.
  const Real root = sqrt(max(1 + 4 * chain.encoder_buildup * position, kTurningPoint));
  const Encoded read = encode(chain.eccentricity, 2 * position / (1 + root));
  return {chain.encoder_gain * read.value, chain.encoder_gain * read.slope / root};
}

Real within_turn(const Chain& chain, Real difference) {
  return chain.actuator == Actuator::revolute
             ? without_turns(difference, 2 * kPi * chain.encoder_gain)
             : difference;
}

Driven driven_point(const Chain& chain, Real q) {
  const Real position = motor_position(chain, q);
  const Real rate = chain.encoder_errs ? 1 / encode(chain, position).slope : 1;
  switch (chain.actuator) {
    case Actuator::prismatic: return {chain.axis * position, chain.axis * rate, chain.rod, rate};
    case Actuator::telescopic: return {Vec3::Zero(), Vec3::Zero(), position, rate};
    default: break;
  }
  const Vec3 e = chain.arm * chain.zero, w = chain.axis.cross(e);
  const Real c = cos(position), s = sin(position);
  return {c * e + s * w, rate * (c * w - s * e), chain.rod, rate};
}

Outcome beyond_limits(const Robot& robot, const Joint& q) {
  if (!robot.finished) return {Status::unfinished};
  for (int i : range(robot.motors)) {
    const Real position = motor_position(robot.chain[i], q[i]);
    if (!(position >= robot.chain[i].low && position <= robot.chain[i].high))
      return {Status::joint_limit, i};
  }
  return {};
}

Outcome within_limits(const Robot& robot, const Pose& pose, const Joint& q) {
  for (int j = 0; j < passive_axes(robot.mobility) && robot.limited; ++j)
    if (!(pose.D[j] >= robot.axis[j].low && pose.D[j] <= robot.axis[j].high))
      return {Status::joint_limit};
  return within_limits(robot, q);
}

Real shortfall(const Chain& chain, const Vec3& d) {
  if (chain.actuator == Actuator::telescopic) return 0;
  const Real along = chain.axis.dot(d);
  const Real across = sqrt(max(d.squaredNorm() - along * along, 0.0));
  if (chain.actuator == Actuator::prismatic) return max(across - chain.rod, 0.0);
  const Real nearest = Vec3(across - chain.arm, along, 0).norm();
  const Real farthest = Vec3(across + chain.arm, along, 0).norm();
  return chain.rod < nearest ? nearest - chain.rod : min(farthest - chain.rod, 0.0);
}

bool close(const Chain& chain, const Vec3& d, bool angle, ChainState& state) {
  const Real sign = chain.working_mode, d2 = d.squaredNorm();
  Real position = 0;
  state.rate = 1;
  switch (chain.actuator) {
    case Actuator::telescopic: {
      position = sqrt(d2);
      state.p = state.dB = Vec3::Zero();
      state.jq = -position;
      if (!(position > 0 && position < INFINITY)) return false;
      break;
    }
    case Actuator::prismatic: {
      const Real along = chain.axis.dot(d);
      const Real root2 = chain.rod * chain.rod - d2 + along * along;
      if (!(root2 >= 0)) return false;
      state.jq = sign * sqrt(root2);
      position = along + state.jq;
      state.p = position * chain.axis;
      state.dB = chain.axis;
      break;
    }
    default: {  // a cos q + b sin q = c, from |p - d|² = L²
      const Vec3 e = chain.arm * chain.zero, w = chain.axis.cross(e);
      const Real a = e.dot(d), b = w.dot(d);
      const Real c = 0.5 * (chain.arm * chain.arm + d2 - chain.rod * chain.rod);
      const Real r2 = a * a + b * b, root2 = r2 - c * c;
      if (!(root2 >= 0) || !(r2 > 0)) return false;
      state.jq = sign * sqrt(root2);
      const Real cosine = (a * c - b * state.jq) / r2, sine = (b * c + a * state.jq) / r2;
      if (angle || chain.encoder_errs)  // tan(q/2) = sin/(1 + cos): half the cost, where regular
        position = cosine > -0.5 ? 2 * std::atan(sine / (1 + cosine)) : atan2(sine, cosine);
      state.p = cosine * e + sine * w;
      state.dB = cosine * w - sine * e;
      break;
    }
  }
  if (chain.encoder_errs) {
    const Encoded read = encode(chain, position);
    position = read.value;
    state.rate = 1 / read.slope;
    state.jq *= state.rate;
    state.dB *= state.rate;
  }
  state.q = position - chain.encoder_offset;
  state.v = state.p - d;
  return true;
}
}  // namespace truepose
