#include "mechanism/damping.hpp"

namespace truepose {
Outcome jacobian(Closure& closure, Real band, Jacobians& jacobians) {
  const Outcome exact = jacobian(closure, jacobians);
  if (!(band > 0)) return exact;
  const Conditioning conditioning(closure);
  const bool dependent = conditioning.parallel() < band;
  Outcome outcome{Status::ok, -1};
  if (dependent || !exact) {
    for (int i = 0; i < jacobians.n; ++i) {
      jx_row(closure.carried, closure.chain[i].v, closure.chain[i].lever, jacobians.jx[i].data());
      jacobians.jq[i] = closure.chain[i].jq;
    }
    if (!conditioning.damped(closure, band, jacobians.J)) return {Status::singular, -1};
    outcome.status = Status::near_singular;
  }
  for (int i = 0; i < jacobians.n; ++i) {
    if (!(conditioning.serial(i) < band)) continue;
    closure.chain[i].jq = jacobians.jq[i] = conditioning.divisor(i, jacobians.jq[i], band);
    if (outcome.chain < 0 && !dependent) outcome = {Status::near_singular, i};
  }
  return outcome;
}

Outcome conditioning(const Robot& robot, const Coordinates& x, Real& parallel, Joint& serial) {
  Closure closure;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure, false);
  if (!outcome) return outcome;
  const Conditioning at(closure);
  parallel = at.parallel();
  for (int i = 0; i < closure.carried.n; ++i) serial[i] = at.serial(i);
  return {all_finite(serial, closure.carried.n) ? Status::ok : Status::not_finite, -1};
}
}  // namespace truepose
