// What is wrong with the description of a mechanism, and with which part.
#include "mechanism/mechanism.hpp"

namespace truepose::engine {
namespace {
bool below(int index, int count) { return index >= 0 && index < count; }
/// Whether an index is below the count, or -1: none.
bool none_or_below(int index, int count) { return below(index + 1, count + 1); }
}  // namespace

Check check_parts(const Mechanism& m) {
  const int unknowns = m.freedoms - min(m.motors, m.coordinates);
  if (!below(m.bodies, kBodies + 1)) return {Flaw::too_many_bodies, -1, Real(m.bodies)};
  if (!below(m.closures, kClosures + 1)) return {Flaw::too_many_closures, -1, Real(m.closures)};
  if (!below(m.freedoms, kFreedoms + 1) || unknowns > kMaxUnknowns)
    return {Flaw::too_many_freedoms, -1, Real(m.freedoms)};
  if (m.motors < 0 || m.coordinates < 0 || m.motors + m.coordinates > m.freedoms)
    return {Flaw::no_such_part, -1};
  for (int b : range(m.bodies)) {
    const Body& body = m.body[b];
    const int most = body.kind == Kind::shift || body.kind == Kind::ball ? 3 : 1;
    if (!none_or_below(body.parent, m.bodies) || !below(body.count - 1, most) ||
        !below(body.freedom, m.freedoms - body.count + 1))
      return {Flaw::no_such_part, b};
    if (body.parent >= b) return {Flaw::circle, b};
  }
  for (int i : range(m.closures)) {
    const Closure& of = m.closure[i];
    if (!none_or_below(of.body_a, m.bodies) || !none_or_below(of.body_b, m.bodies) ||
        !none_or_below(of.driven, m.freedoms) || !none_or_below(of.motor, m.freedoms) ||
        (of.mode != 0 && of.motor < 0))
      return {Flaw::no_such_part, kBodies + i};
  }
  return {};
}

int rank(std::array<Row, kClosures> m, int rows, int columns, std::array<int, kClosures>* order,
         std::array<int, kFreedoms>* held) {
  std::array<int, kClosures> original;
  std::array<int, kFreedoms> freedom;
  for (int i : range(rows)) original[i] = i;
  for (int j : range(columns)) freedom[j] = j;
  for (int j : range(columns)) {
    Real size = 0;
    for (int i : range(rows)) size = max(size, fabs(m[i][j]));
    for (int i = 0; i < rows && size > 0; ++i) m[i][j] /= size;
  }
  int k = 0;
  for (; k < min(rows, columns); ++k) {
    int row = k, column = k;
    for (int i : range(k, rows))
      for (int j : range(k, columns))
        if (fabs(m[i][j]) > fabs(m[row][column])) row = i, column = j;
    if (!(fabs(m[row][column]) > 1e-6)) break;
    std::swap(m[k], m[row]);
    std::swap(original[k], original[row]);
    std::swap(freedom[k], freedom[column]);
    for (int i : range(rows)) std::swap(m[i][k], m[i][column]);
    for (int i : range(k + 1, rows)) {
      const Real factor = m[i][k] / m[k][k];
      for (int j : range(k, columns)) m[i][j] -= factor * m[k][j];
    }
  }
  if (order) *order = original;
  if (held) *held = freedom;
  return k;
}

Check check(const Mechanism& m, Position& at) {
  if (const Check parts = check_parts(m); !parts) return parts;
  const FkmResult closed = close(m, at, inverse(m));
  if (closed.status == Status::unreachable) return {Flaw::no_length, closed.chain};
  const bool open = !(closed.residual < kClosed) || closed.status == Status::not_converged;
  std::array<Row, kClosures> all, free;
  Row size{};
  int widest = 0;
  for (int i : range(m.closures)) {
    if (fabs(gap(m, at, i)) > fabs(gap(m, at, widest))) widest = i;
    Row own{};
    all[i] = row(m, at, i, own);
    bool moved = false;
    for (int j : range(m.freedoms)) {
      moved = moved || all[i][j] * all[i][j] > kSingular * own[j];
      size[j] += all[i][j] * all[i][j];
    }
    if (!moved) return {Flaw::unmoved, i};
    std::copy(all[i].begin() + m.motors, all[i].begin() + m.freedoms, free[i].begin());
  }
  for (int j : range(m.motors))
    if (size[j] == 0) return {Flaw::idle, j};
  if (open) return {Flaw::open, widest, at.residual};
  std::array<int, kClosures> order;
  if (const int held = rank(all, m.closures, m.freedoms, &order); held < m.closures)
    return {Flaw::dependent, order[held], Real(m.closures - held)};
  const int unknowns = m.freedoms - m.motors;
  std::array<int, kFreedoms> freedom;
  if (const int held = rank(free, m.closures, unknowns, nullptr, &freedom); held < unknowns)
    return {Flaw::loose, m.motors + freedom[held], Real(unknowns - held)};
  return {};
}
}  // namespace truepose::engine
