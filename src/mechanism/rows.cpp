// Derivatives of closures and readings: twist times line.
#include "mechanism/mechanism.hpp"

namespace truepose::engine {
namespace {
/// Calls f(freedom, twist, reach²) for every freedom that moves a body; reach² is the squared speed
/// of the point `end` if it moved at a right angle to the joint.
template <class F>
inline void for_each_twist(const Mechanism& mechanism, const Position& at, int body,
                           const Vec3& end, F&& f) {
  for (int b = body; b >= 0; b = mechanism.body[b].parent) {
    const Body& moved = mechanism.body[b];
    const Frame& frame = at.frame[b];
    const Real distance2 = moved.kind >= Kind::hinge ? (end - frame.p).squaredNorm() : 1;
    const Real reach2 = distance2 * moved.ratio * moved.ratio;
    for (int k : range(moved.count)) f(moved.freedom + k, frame.twist[k], reach2);
  }
}
}  // namespace

void add_line(const Mechanism& mechanism, const Position& at, int body, const Line& line, Real sign,
              Row& row) {
  for_each_twist(mechanism, at, body, Vec3::Zero(), [&](int freedom, const Twist& twist, Real) {
    row[freedom] += sign * (twist * line);
  });
}

Row row(const Mechanism& mechanism, const Position& at, int closure) {
  Row size{};
  return row(mechanism, at, closure, size);
}

Row row(const Mechanism& mechanism, const Position& at, int closure, Row& size) {
  const Closure& of = mechanism.closure[closure];
  const Line line = at.line[closure];
  const Real force2 = line.force.squaredNorm();
  Row row;
  std::fill_n(row.begin(), mechanism.freedoms, Real(0));
  // A rod's line passes through both ends; a plane turns about B and moves past A.
  const auto enter = [&](int body, const Vec3& end, Real sign) {
    for_each_twist(mechanism, at, body, end, [&](int freedom, const Twist& twist, Real reach2) {
      row[freedom] += sign * (twist * line);
      size[freedom] += force2 * reach2;
    });
  };
  enter(of.body_a, at.A[closure], 1);
  enter(of.body_b, at.B[closure], -1);
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

Real serial(const Mechanism& mechanism, const Position& at, int closure) {
  const Closure& of = mechanism.closure[closure];
  const Line& line = at.line[closure];
  Real slope = 0, size = 0;
  for_each_twist(mechanism, at, of.body_b, at.B[closure],
                 [&](int freedom, const Twist& twist, Real reach2) {
                   if (freedom != of.motor) return;
                   slope -= twist * line;
                   size += line.force.squaredNorm() * reach2;
                 });
  return size > 0 ? slope / sqrt(size) : 0;
}

int mode_of(const Mechanism& mechanism, const Position& at, int closure) {
  const Real along = serial(mechanism, at, closure);
  return !(along * along > kSingular) ? 0 : along > 0 ? 1 : -1;
}

Real parallel(const Mechanism& mechanism, const Position& at) {
  const Freedoms free = forward(mechanism);
  const int rows = mechanism.closures, columns = free.count;
  Square A, inverse;
  Unknowns size{}, ones;
  ones.fill(1);
  for (int i : range(rows)) {
    Row own{};
    const Row by = row(mechanism, at, i, own);
    const Real force2 = at.line[i].force.squaredNorm();
    for (int j : range(columns)) {
      A[i][j] = by[free.index[j]] / sqrt(force2);
      size[j] += own[free.index[j]] / force2;
    }
  }
  Real square = 0, inverse2 = 0;
  for (int i : range(rows))
    for (int j : range(columns)) square += A[i][j] * A[i][j] / size[j], A[i][j] /= sqrt(size[j]);
  if (!invert(rows, columns, A, ones, inverse)) return 0;
  for (int j : range(columns))
    for (int i : range(rows)) inverse2 += inverse[j][i] * inverse[j][i];
  return columns / sqrt(square * inverse2);
}
}  // namespace truepose::engine
