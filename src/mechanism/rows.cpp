// Derivatives of closures and readings: twist times line.
#include "mechanism/mechanism.hpp"

namespace truepose::engine {
namespace {
/// Calls f(freedom, twist, reach²) for every freedom that moves a body. reach is the speed of the
/// point `end` if it moved at a right angle to the joint.
template <class F>
inline void for_each_twist(const Mechanism& mechanism, const Position& at, int body,
                           const Vec3& end, F&& f) {
  for (int b = body; b >= 0; b = mechanism.body[b].parent) {
    const Body& moved = mechanism.body[b];
    const Frame& frame = at.frame[b];
    const Real distance2 = moved.kind >= Kind::hinge ? (end - frame.p).squaredNorm() : 1;
    const Real reach2 = distance2 * moved.ratio * moved.ratio;
    for (int k = 0; k < moved.count; ++k) f(moved.freedom + k, frame.twist[k], reach2);
  }
}
}  // namespace

void add_line(const Mechanism& mechanism, const Position& at, int body, const Line& line, Real sign,
              Row& row) {
  for_each_twist(mechanism, at, body, Vec3::Zero(), [&](int freedom, const Twist& twist, Real) {
    row[freedom] += sign * (twist * line);
  });
}

Row row(const Mechanism& mechanism, const Position& at, int closure, Row& size) {
  const Closure& of = mechanism.closure[closure];
  const Line line = at.line[closure];
  const Real force2 = line.force.squaredNorm();
  Row row;
  std::fill_n(row.begin(), mechanism.freedoms, Real(0));
  // A rod's line passes through both ends; a plane turns about B and moves past A.
  for_each_twist(mechanism, at, of.body_a, at.A[closure],
                 [&](int freedom, const Twist& twist, Real reach2) {
                   row[freedom] += twist * line;
                   size[freedom] += force2 * reach2;
                 });
  for_each_twist(mechanism, at, of.body_b, at.B[closure],
                 [&](int freedom, const Twist& twist, Real reach2) {
                   row[freedom] -= twist * line;
                   size[freedom] += force2 * reach2;
                 });
  if (of.driven >= 0) {
    row[of.driven] -= length_of(mechanism, at, closure);
    size[of.driven] += force2;
  }
  return row;
}

bool carries(const Mechanism& mechanism, int body, int carried) {
  while (carried > body) carried = mechanism.body[carried].parent;
  return carried >= 0 && carried == body;
}

int mode_of(const Mechanism& mechanism, const Position& at, int closure) {
  const Closure& of = mechanism.closure[closure];
  const Line& line = at.line[closure];
  Real slope = 0, size = 0;
  for_each_twist(mechanism, at, of.body_b, at.B[closure],
                 [&](int freedom, const Twist& twist, Real reach2) {
                   if (freedom != of.motor) return;
                   slope -= twist * line;
                   size += line.force.squaredNorm() * reach2;
                 });
  return !(slope * slope > kSingular * size) ? 0 : slope > 0 ? 1 : -1;
}
}  // namespace truepose::engine
