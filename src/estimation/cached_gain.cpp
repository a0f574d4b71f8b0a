// The gain matrix of an estimate, cached from cycle to cycle.
#include "estimation/cached_gain.hpp"

namespace truepose {
std::uint64_t fingerprint(const Robot& robot, const Knowledge& known) {
  std::uint64_t mark = 14695981039346656037ULL;
  const auto word = [&](std::uint64_t value) { mark = (mark ^ value) * 1099511628211ULL; };
  using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
  const auto number = [&](Real value) { word(std::bit_cast<Bits>(value)); };
  const auto vectors = [&](auto... vector) { (std::for_each_n(vector->data(), 3, number), ...); };
  const auto encoder = [&](const Eccentricity& of) {
    number(of.gear);
    for (const Real amplitude : of.amplitude) number(amplitude);
  };
  word(std::uint64_t(robot.level) << 32 | std::uint32_t(robot.r));
  for (int i : range(robot.chains)) {
    const Chain& chain = robot.chain[i];
    vectors(&chain.base, &chain.axis, &chain.zero, &chain.pivot, &chain.anchor, &chain.pair_axis,
            &chain.pair_drawn);
    for (const Real value : {chain.arm, chain.rod, chain.encoder_offset, chain.encoder_gain,
                             chain.encoder_buildup, chain.rod_spacing, chain.rod_difference})
      number(value);
    encoder(chain.eccentricity);
  }
  for (int k : range(robot.r)) {
    const Sensor& sensor = robot.sensor[k];
    word(std::uint64_t(sensor.kind) << 32 | std::uint32_t(sensor.chain));
    vectors(&sensor.origin, &sensor.direction, &sensor.target, &sensor.normal);
    number(sensor.gain);
    number(sensor.offset);
    encoder(sensor.eccentricity);
  }
  for (int k : range(known.count)) {
    word(std::uint32_t(known.column[k]));
    if (known.root) number(known.root[k * known.count + k]);
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
