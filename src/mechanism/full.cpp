#include "mechanism/full.hpp"

namespace truepose {
FullPose to_full(const Pose& pose) {
  FullPose full{pose};
  full.psi.fill(-pose.theta);
  return full;
}

void complete_closure(const Robot& robot, FullClosure& at) {
  std::array<Mat3, kMaxBars> bar;
  for (int k = 0; k < kMaxBars; ++k) bar[k] = at.pose.R * rotation_z(at.pose.psi[k]);
  at.cost = at.residual = 0;
  for (int i = 0; i < dof(robot.mobility); ++i) {
    const Chain& chain = robot.chain[i];
    const Driven& driven = at.driven[i];
    const Mat3& R = chain.bar < 0 ? at.pose.R : bar[chain.bar];
    const Vec3 pivot = at.pose.R * chain.pivot, arm = R * chain.anchor;
    const Vec3 half_A = R * (0.5 * chain.rod_spacing * chain.pair_drawn);
    const Vec3 half_B = 0.5 * chain.rod_spacing * pair_direction(chain);
    const Vec3 middle = chain.base + driven.p - at.pose.D - pivot - arm;
    for (int rod = 2 * i; rod < 2 * i + 2; ++rod) {
      const Real side = rod == 2 * i ? 1 : -1;
      const Real length = rod_length(chain, driven, side);
      at.arm[rod] = arm + side * half_A;
      at.lever[rod] = pivot + at.arm[rod];
      at.v[rod] = middle + side * (half_B - half_A);
      at.f[rod] = 0.5 * (at.v[rod].squaredNorm() - length * length);
      // u is the axis about which B turns (or keeps its direction): ∂B/∂q is the chain's.
      at.jq[rod] =
          chain.actuator == Actuator::telescopic ? -length * driven.rate : at.v[rod].dot(driven.dB);
      at.cost += at.f[rod] * at.f[rod];
      at.residual = std::max(at.residual, std::fabs(at.f[rod]) / length);
    }
  }
}

void full_row(const Robot& robot, const FullClosure& at, int rod,
              std::array<Real, kMaxUnknowns>& row) {
  const Vec3 moment = at.lever[rod].cross(at.v[rod]);
  for (int k = 0; k < 3; ++k) {
    row[k] = at.v[rod][k];
    row[3 + k] = moment[k];
  }
  row[6] = row[7] = 0;
  const int bar = robot.chain[rod / 2].bar;
  if (bar >= 0) row[6 + bar] = at.pose.R.col(2).dot(at.arm[rod].cross(at.v[rod]));
}

int rank(Matrix<kMaxRods, kMaxUnknowns> m, int rows, int columns) {
  for (int j = 0; j < columns; ++j) {
    Real size = 0;
    for (int i = 0; i < rows; ++i) size = std::max(size, std::fabs(m[i][j]));
    for (int i = 0; i < rows && size > 0; ++i) m[i][j] /= size;
  }
  for (int k = 0; k < std::min(rows, columns); ++k) {
    int row = k, column = k;
    for (int i = k; i < rows; ++i)
      for (int j = k; j < columns; ++j)
        if (std::fabs(m[i][j]) > std::fabs(m[row][column])) row = i, column = j;
    if (!(std::fabs(m[row][column]) > 1e-6)) return k;
    std::swap(m[k], m[row]);
    for (int i = 0; i < rows; ++i) std::swap(m[i][k], m[i][column]);
    for (int i = k + 1; i < rows; ++i) {
      const Real factor = m[i][k] / m[k][k];
      for (int j = k; j < columns; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  return std::min(rows, columns);
}

Outcome full_rows(const Robot& robot, bool together, Matrix<kMaxRods, kMaxUnknowns>& rows) {
  Closure ideal;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, robot.home), ideal);
  if (!outcome) return outcome;
  FullClosure at;
  at.pose = to_full(ideal.pose);
  for (int i = 0; i < dof(robot.mobility); ++i)
    at.driven[i] = driven_point(robot.chain[i], ideal.chain[i].q);
  complete_closure(robot, at);
  for (int rod = 0; rod < rods_of(robot); ++rod) {
    full_row(robot, at, rod, rows[rod]);
    if (together) rows[rod][6] += rows[rod][7];
  }
  return outcome;
}

void relax(const Robot& robot, FullClosure& at) {
  constexpr int N = kMaxUnknowns, m = N - 1;
  Square A, normal{};
  Unknowns size;
  for (int rod = 0; rod < N; ++rod) {
    std::array<Real, kMaxUnknowns> row;
    full_row(robot, at, rod, row);
    row[6] += row[7];
    std::copy_n(row.begin(), m, A[rod].begin());
    for (int i = 0; i < m; ++i)
      for (int j = 0; j <= i; ++j) normal[i][j] += A[rod][i] * A[rod][j];
  }
  for (int i = 0; i < m; ++i) size[i] = normal[i][i];
  const Ldlt factor(m, normal, size);
  std::array<Real, N> s{};
  for (int k = 0; k < N; ++k) {  // s_k² is at least 1/N for one of them
    Unknowns x = A[k];
    factor.solve(x);
    for (int rod = 0; rod < N; ++rod) {
      s[rod] = rod == k;
      for (int j = 0; j < m; ++j) s[rod] -= A[rod][j] * x[j];
    }
    if (s[k] > 0.5 / N) break;
  }
  Real held = 0, unit = 0;  // sᵀf and sᵀD²s
  for (int rod = 0; rod < N; ++rod) {
    const Real length = at.driven[rod / 2].rod;
    at.stress[rod] = length * length * s[rod];
    held += s[rod] * at.f[rod];
    unit += s[rod] * at.stress[rod];
  }
  at.cost = at.residual = 0;
  for (int rod = 0; rod < N; ++rod) {
    at.f[rod] -= held / unit * at.stress[rod];
    at.cost += at.f[rod] * at.f[rod];
    at.residual = std::max(at.residual, std::fabs(at.f[rod]) / at.driven[rod / 2].rod);
  }
}

Outcome full_level(const Robot& robot, FullLevel& level) {
  const int n = dof(robot.mobility);
  level = {};
  bool described = true;
  for (int i = 0; i < n; ++i) {
    level.bars = std::max(level.bars, robot.chain[i].bar + 1);
    described = described && robot.chain[i].rod_spacing > 0;
  }
  if (!paired(robot.mobility)) {
    level.kind = FullKind::same;
    level.rods = level.unknowns = n;
    return {};
  } else {
    if (!described || level.bars > kMaxBars) return {};
    const bool together = bars_together(robot, level.bars);
    level.rods = rods_of(robot);
    level.unknowns = 6 + (together ? 1 : level.bars);
    if (level.unknowns > level.rods) {
      level.kind = FullKind::loose;
      level.excess = level.unknowns - level.rods;
      return {};
    }
    Matrix<kMaxRods, kMaxUnknowns> rows{};
    const Outcome outcome = full_rows(robot, together, rows);
    if (!outcome) return outcome;
    const int held = rank(rows, level.rods, level.unknowns);
    if (held < level.unknowns) {
      level.kind = FullKind::loose;
      level.excess = level.unknowns - held;
    } else if (level.rods > level.unknowns) {
      level.excess = level.rods - level.unknowns;
      const bool relieved = level.excess == 1 && level.rods == kMaxUnknowns;
      level.kind = relieved ? FullKind::elastic : FullKind::overconstrained;
    } else {
      level.kind = FullKind::exists;
      Square square;
      std::copy_n(rows.begin(), level.rods, square.begin());
      level.sign = determinant_sign(level.rods, square);
    }
    return {};
  }
}
}  // namespace truepose
