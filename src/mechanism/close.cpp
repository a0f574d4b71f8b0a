// Solution of a mechanism's closures for any set of unknown freedoms, and its derivatives.
#include "math/newton.hpp"
#include "mechanism/mechanism.hpp"

namespace truepose::engine {
namespace {
/// Moves the unknown freedoms by -step; a ball by a small turn.
void move(const Mechanism& mechanism, const Position& from, const Freedoms& unknown,
          const Unknowns& step, Position& to) {
  copy_first(mechanism.freedoms, from.y, to.y);
  for (int j : range(unknown.count)) to.y[unknown.index[j]] -= step[j];
  for (int b : range(mechanism.bodies)) {
    if (mechanism.body[b].kind != Kind::ball) continue;
    const int first = mechanism.body[b].freedom;
    const Vec3 w(from.y[first], from.y[first + 1], from.y[first + 2]);
    const Vec3 turn = Vec3(to.y[first], to.y[first + 1], to.y[first + 2]) - w;
    if (turn.squaredNorm() == 0) continue;
    const Vec3 turned = log_so3(exp_so3(turn) * exp_so3(w));
    copy_first(3, turned, to.y.begin() + first);
  }
}

/// Bodies that the unknown freedoms move, as bits.
unsigned moved_by(const Mechanism& mechanism, const Freedoms& unknown) {
  unsigned moving = 0;
  for (int b : range(mechanism.bodies)) {
    const Body& body = mechanism.body[b];
    bool moves = body.parent >= 0 && (moving >> body.parent & 1);
    for (int j : range(unknown.count))
      moves = moves ||
              (unknown.index[j] >= body.freedom && unknown.index[j] < body.freedom + body.count);
    moving |= unsigned(moves) << b;
  }
  return moving;
}

/// The first closure in another working mode, or -1.
int other_working_mode(const Mechanism& mechanism, const Position& at) {
  for (int i : range(mechanism.closures))
    if (const int mode = mechanism.closure[i].mode; mode != 0 && mode_of(mechanism, at, i) == -mode)
      return i;
  return -1;
}
}  // namespace

Freedoms motors(const Mechanism& mechanism) {
  Freedoms list;
  list.add(0, mechanism.motors);
  return list;
}

Freedoms forward(const Mechanism& mechanism) {
  Freedoms list;
  list.add(mechanism.motors, mechanism.freedoms);
  return list;
}

Freedoms inverse(const Mechanism& mechanism) {
  Freedoms list = motors(mechanism);
  list.add(mechanism.motors + mechanism.coordinates, mechanism.freedoms);
  return list;
}

ClosureRows::ClosureRows(const Mechanism& mechanism, const Position& at, const Freedoms& unknown,
                         bool stressed) {
  Row sizes{};
  for (int i : range(mechanism.closures)) {
    by[i] = row(mechanism, at, i, sizes);
    for (int j : range(unknown.count)) A[i][j] = by[i][unknown.index[j]];
    if (!stressed) continue;
    A[i][unknown.count] = -at.stress[i];  // f - λ stress
    size[unknown.count] += at.stress[i] * at.stress[i];
  }
  for (int j : range(unknown.count)) size[j] = sizes[unknown.index[j]];
}

FkmResult close(const Mechanism& mechanism, Position& at, const Freedoms& unknown, int most,
                bool near) {
  place(mechanism, at);
  FkmResult result;
  Real scale = 0;  // the longest rod; of planes how far out their points are
  for (int i : range(mechanism.closures)) {
    if (mechanism.closure[i].plane) {
      scale = max({scale, at.A[i].norm(), at.B[i].norm()});
      continue;
    }
    const Real length = length_of(mechanism, at, i);
    if (!(length > 0)) return {{Status::unreachable, i}};
    scale = max(scale, length);
  }
  if (!isfinite(at.cost)) return {{Status::not_finite}};

  NewtonEnd end;
  if (!(near && at.residual <= kRounding * scale)) {
    const unsigned moving = moved_by(mechanism, unknown);
    Position other;
    for (int b : range(mechanism.bodies)) other.frame[b] = at.frame[b];
    Position *current = &at, *trial = &other;
    end = damped_newton(
        current, trial, scale, most,
        [&](const Position& from, Real damping) {
          return Equations(mechanism, from, unknown, damping);
        },
        [&](const Position& from, const Equations& equations, Position& after) {
          move(mechanism, from, unknown, equations.solve(from.f.data()), after);
          place(mechanism, after, moving);
        });
    if (current != &at) at = *current;
  }
  result.iterations = end.iterations;
  result.residual = at.residual;
  if (!(at.residual < kClosed * scale)) {
    result.status = end.crawls(at.residual, scale) ? Status::singular : Status::not_converged;
  } else if (!end.regular) {
    result.status = Status::singular;
  } else if ((result.chain = other_working_mode(mechanism, at)) >= 0) {
    result.status = Status::branch_lost;
  }
  return result;
}

Outcome follow(const Mechanism& mechanism, const Position& at, const Freedoms& unknown,
               const Freedoms& held, Matrix<kMaxUnknowns, kMaxUnknowns>& rates) {
  for (int i : range(mechanism.closures))
    if (stretched(mechanism, at, i)) return {Status::singular, i};
  const Equations equations(mechanism, at, unknown);
  if (!equations.regular()) return {Status::singular};
  std::array<Real, kClosures> f;
  for (int j : range(held.count)) {
    for (int i : range(mechanism.closures)) f[i] = -equations.by[i][held.index[j]];
    const Unknowns column = equations.solve(f.data());
    for (int i : range(unknown.count)) rates[i][j] = column[i];
  }
  return {};
}

int mode_of(const Mechanism& mechanism, const Position& at) {
  return Equations(mechanism, at, forward(mechanism), 0, false).sign();
}
}  // namespace truepose::engine
