// Where the bodies of a mechanism are, from its freedoms.
#include "mechanism/mechanism.hpp"

namespace truepose::engine {
namespace {
/// Frame of a body from its parent's. @param p, R  of the parent
void place_body(const Body& body, const Real* y, const Vec3& p, const Mat3& R, Frame& at) {
  const Vec3 origin = p + R * body.origin;
  at.p = origin;
  at.R = R;
  const auto turns_about = [&](const Vec3& axis) { return Twist{origin.cross(axis), axis}; };
  switch (body.kind) {
    case Kind::shift:
      for (int k : range(body.count)) {
        at.twist[k] = {R.col(k), Vec3::Zero()};
        at.p += y[k] * R.col(k);
      }
      break;
    case Kind::ball:
      at.R = R * exp_so3(Vec3(y[0], y[1], y[2]));
      for (int k : range(3)) at.twist[k] = turns_about(R.col(k));
      break;
    case Kind::slide: {
      const Vec3 along = R * body.axis;
      at.twist[0] = {body.ratio * along, Vec3::Zero()};
      at.p += (body.offset + body.ratio * y[0]) * along;
      break;
    }
    case Kind::hinge: {
      const Real angle = body.offset + body.ratio * y[0];
      at.R = R * turn_about(body.axis, cos(angle), sin(angle));
      at.twist[0] = turns_about(body.ratio * (R * body.axis));
      break;
    }
  }
}

/// f of a closure and its line: along the rod, or normal to the plane, through A.
void place_closure(const Mechanism& mechanism, Position& at, int i) {
  const Closure& closure = mechanism.closure[i];
  const Vec3 A = at.A[i] = at.point(closure.body_a, closure.a);
  const Vec3 d = A - (at.B[i] = at.point(closure.body_b, closure.b));
  Vec3 along = d;
  if (closure.plane) {
    along = at.direction(closure.body_b, closure.normal);
    at.f[i] = along.dot(d);
  } else {
    const Real length = length_of(mechanism, at, i);
    at.f[i] = 0.5 * (d.squaredNorm() - length * length);
  }
  at.line[i] = line_through(A, along);
}

/// Takes from f of an elastic mechanism what no freedom of the platform relieves: the part along
/// its stress. The springs' energy ½Σf²/c is least where f = λ C s, C = diag(c) their compliances
/// and s normal to all columns of ∂f/∂(x, h): as many equations as unknowns, λ included.
void relax(const Mechanism& mechanism, Position& at) {
  const int closures = mechanism.closures, unknowns = mechanism.freedoms - mechanism.motors;
  const Equations freedoms(mechanism, at, forward(mechanism), 0, false);
  std::array<Real, kClosures> s{};
  for (int k : range(closures)) {
    const Unknowns x = freedoms.column(k);  // s: column k of 1 - A A⁺
    for (int i : range(closures))
      s[i] = Real(i == k) - sum_of(unknowns, [&](int j) { return freedoms.A[i][j] * x[j]; });
    if (s[k] > 0.5 / closures) break;  // s_k² of the unit stress is at least 1/closures for one
  }
  Real held = 0, unit = 0;  // sᵀf and sᵀC s
  for (int i : range(closures)) {
    at.stress[i] = mechanism.closure[i].compliance * s[i];
    held += s[i] * at.f[i];
    unit += s[i] * at.stress[i];
  }
  for (int i : range(closures)) at.f[i] -= held / unit * at.stress[i];
}
}  // namespace

Real length_of(const Mechanism& mechanism, const Position& at, int closure) {
  const Closure& rod = mechanism.closure[closure];
  return rod.length + (rod.driven < 0 ? 0 : at.y[rod.driven]);
}

Real gap(const Mechanism& mechanism, const Position& at, int closure) {
  return at.f[closure] / (mechanism.closure[closure].plane ? 1 : length_of(mechanism, at, closure));
}

void place(const Mechanism& mechanism, Position& at, unsigned moving) {
  for (int b : range(mechanism.bodies)) {
    if (!(moving >> b & 1)) continue;
    const Body& body = mechanism.body[b];
    const Real* y = &at.y[body.freedom];
    if (body.parent < 0) {
      place_body(body, y, Vec3::Zero(), Mat3::Identity(), at.frame[b]);
    } else {
      const Frame& parent = at.frame[body.parent];
      place_body(body, y, parent.p, parent.R, at.frame[b]);
    }
  }
  for (int i : range(mechanism.closures)) place_closure(mechanism, at, i);
  if (mechanism.elastic) relax(mechanism, at);
  at.cost = at.residual = 0;
  for (int i : range(mechanism.closures)) {
    at.cost += at.f[i] * at.f[i];
    at.residual = max(at.residual, fabs(gap(mechanism, at, i)));
  }
}
}  // namespace truepose::engine
