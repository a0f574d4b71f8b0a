// The gain matrix of an estimate, cached from cycle to cycle.
#include "estimation/cached_gain.hpp"

namespace truepose {
std::uint64_t fingerprint(const Robot& robot, const Knowledge& known) {
  std::uint64_t mark = 14695981039346656037ULL;
  using Word = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
  const auto words = [&]<class Part>(const Part& part) {
    using Words = std::array<Word, sizeof part / sizeof(Word)>;
    for (const Word word : std::bit_cast<Words>(part)) mark = (mark ^ word) * 1099511628211ULL;
  };
  words(std::array{int(robot.level), robot.r});
  for (int i : range(robot.chains)) words(robot.chain[i]);
  for (int k : range(robot.r)) words(robot.sensor[k]);
  for (int k : range(known.count)) {
    words(std::array{known.column[k], 0});
    if (known.root) words(known.root[k * known.count + k]);
  }
  return mark | 1;
}

Outcome refresh(const Robot& robot, const Knowledge& known, std::uint64_t mark, const Joint& q,
                const PoseRows& H_x, const Real* H_xi, Real* B, CachedGain& kept,
                CachedFusion& at) {
  const int n = dof(robot.mobility);
  const int rows = n + robot.r, p = known.count;
  Matrix<kMaxDof, kMaxSensors> before{};  // K of the cached gain
  const Real way = kept.way(n, q);
  const bool compares = kept.of == mark && way > 0 && way < kTooFar && at.weigh(robot, known, kept);
  if (compares) before = at.gain;
  kept.of = 0;  // invalid until complete
  Knowledge geometry = known;
  geometry.sigma.fill(1);
  gather(robot, geometry, H_xi, rows, B);
  times_root(geometry, rows, B);
  for (int m : range(p)) {
    Coordinates e_x;
    for (int i : range(n)) e_x[i] = sum_of(n, [&](int j) { return at.J[i][j] * B[j * p + m]; });
    for (int i : range(n)) B[i * p + m] = e_x[i];
    for (int k : range(n, rows))
      for (int i : range(n)) B[k * p + m] -= H_x[k][i] * e_x[i];
  }
  for (int i : range(rows)) {
    if (!(known.sigma[i] > 0)) return {Status::not_finite};
    for (int j : range(i + 1)) kept.C[i][j] = dot(p, B + i * p, B + j * p);
  }
  const Outcome outcome = at.weigh(robot, known, kept);
  if (!outcome) return outcome;
  if (compares) {
    Real most = 0;
    for (int i : range(n)) {
      std::array<Real, kMaxSensors> apart;  // (K₀ - K) L
      Real sum = 0;
      for (int k : range(robot.r)) {
        apart[k] = 0;
        for (int l : range(k, robot.r)) apart[k] += (before[i][l] - at.gain[i][l]) * at.V.L[l][k];
        sum += apart[k] * apart[k];
      }
      most = max(most, sum / at.variance[i]);
    }
    kept.became = sqrt(most);
    kept.slope = max(kept.became / way, kForgets * kept.slope);
  }
  kept.reach = compares ? kMostReach : kFirstReach;
  if (kept.slope > 0) kept.reach = min(kept.reach, kept.share / (kFaster * kept.slope));
  for (int i : range(n)) kept.q[i] = q[i];
  kept.of = mark;
  return outcome;
}
}  // namespace truepose
