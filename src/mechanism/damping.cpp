// Conditioning of a pose, and a damped Jacobian near singularities.
#include "mechanism/damping.hpp"

#include "mechanism/full.hpp"

namespace truepose {
namespace {
constexpr Unknowns ones() {
  Unknowns result{};
  result.fill(1);
  return result;
}
}  // namespace

Conditioning::Conditioning(const Closure& closure)
    : n_(closure.carried.n), motors_(closure.motors) {
  Joint scale;
  for (int i : range(motors_)) {
    const ChainState& chain = closure.chain[i];
    length_[i] = chain.v.norm();
    scale[i] = 1 / length_[i];
    // A telescopic leg always drives along itself.
    const Real dB = chain.dB.norm();
    speed_[i] = dB > 0 ? dB : fabs(chain.rate);
    serial_[i] = fabs(chain.jq) / (length_[i] * speed_[i]);
  }
  unit_ = jx_rows(closure, scale, lines_);
  for (int j : range(n_)) {
    unit_[j] = sqrt(unit_[j]);
    for (int i : range(motors_)) {
      lines_[i][j] *= 1 / unit_[j];
      square_ += lines_[i][j] * lines_[i][j];
    }
  }
  Square rows;
  inverse_ = invert(motors_, n_, lines_, ones(), rows);
  Real inverse2 = 0;
  for (int i : range(n_))
    for (int j : range(motors_)) inverse2 += rows[i][j] * rows[i][j];
  parallel_ = inverse_ ? n_ / sqrt(square_ * inverse2) : 0;
}

Outcome Conditioning::outcome() const {
  for (int i : range(motors_))
    if (!(serial_[i] * serial_[i] > kSingular)) return {Status::singular, i};
  return {inverse_ ? Status::ok : Status::singular};
}

bool Conditioning::damped(const Closure& closure, Real band, Square& J) const {
  Square rows = lines_;
  Joint scale;  // J_q in units of the rows
  Real square = square_;
  for (int i : range(motors_)) scale[i] = closure.chain[i].jq / length_[i];
  if (motors_ > n_) {
    square = 0;
    Joint weight;
    Real most = 0;
    for (int i : range(motors_)) {
      weight[i] = fabs(length_[i] / divisor(i, closure.chain[i].jq, band));
      most = max(most, weight[i]);
    }
    for (int i : range(motors_)) {
      scale[i] = copysign(1 / most, closure.chain[i].jq);
      for (int j : range(n_)) {
        rows[i][j] *= weight[i] / most;
        square += rows[i][j] * rows[i][j];
      }
    }
  }
  const Real part = damping(parallel_, band) * square / (n_ * n_);
  const Factors equations(motors_, n_, rows.data(), ones(), part);
  equations.invert(J);
  for (int i : range(n_))
    for (int j : range(motors_)) J[i][j] *= scale[j] / unit_[i];
  return equations.regular();
}

Outcome jacobian(Closure& closure, Real band, Jacobians& jacobians) {
  const Outcome exact = jacobian(closure, jacobians);
  if (!(band > 0)) return exact;
  const Conditioning conditioning(closure);
  const bool dependent = conditioning.parallel() < band;
  Outcome outcome{Status::ok};
  const bool weighted = closure.motors > jacobians.n && conditioning.least() < band;
  if (dependent || weighted || !exact) {
    if (!conditioning.damped(closure, band, jacobians.J)) return {Status::singular};
    outcome.status = Status::near_singular;
  }
  for (int i : range(jacobians.motors)) {
    if (!(conditioning.serial(i) < band)) continue;
    closure.chain[i].jq = jacobians.jq[i] = conditioning.divisor(i, jacobians.jq[i], band);
    if (outcome.chain < 0 && !dependent) outcome = {Status::near_singular, i};
  }
  return outcome;
}

namespace {
/// Of a described mechanism; the serial ones are 1 where no arm or carriage moves a rod.
Outcome by_engine(const Robot& robot, const Coordinates& x, Real& parallel, Joint& serial) {
  FullClosure closure;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  if (!outcome) return outcome;
  const engine::Mechanism& m = closure.built.mechanism;
  parallel = engine::parallel(m, closure.at);
  serial.fill(1);
  for (int i : range(m.closures))
    if (const int motor = m.closure[i].motor; motor >= 0)
      serial[motor] = min(serial[motor], fabs(engine::serial(m, closure.at, i)));
  return outcome;
}
}  // namespace

Outcome conditioning(const Robot& robot, const Coordinates& x, Real& parallel, Joint& serial) {
  if (is_mechanism(robot.mobility)) return by_engine(robot, x, parallel, serial);
  Closure closure;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure, false);
  if (!outcome) return outcome;
  const Conditioning at(closure);
  parallel = at.parallel();
  for (int i : range(closure.motors)) serial[i] = at.serial(i);
  return {all_finite(serial, closure.motors) ? Status::ok : Status::not_finite};
}
}  // namespace truepose
