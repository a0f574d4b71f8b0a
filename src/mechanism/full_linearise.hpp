// Values and derivatives of all readings at the full level.
//
// At fixed x the motors, the platform's tilt and its bars follow a parameter: with y = (q, tilt,
// ψ), A = -∂f/∂y (full_detail::Inverse) and X = -∂f/∂x of all rods' closures f(y; x, ξ) = 0,
//
//     A δy = f_ξ δξ - X δx        δq_e = e_y δy + e_x δx + e_ξ δξ
//
// so that S = e_y A⁻¹, one row per reading, gives H_x = e_x - S X and H_ξ = e_ξ + S f_ξ. A chain's
// parameter moves its own two rods only: two columns of S.
#pragma once

#include "estimation/linearise.hpp"
#include "mechanism/fkm.hpp"
#include "mechanism/full_rkm.hpp"

namespace truepose {
namespace full_detail {
/// Variation of one rod of a pair: its ends are ±s/2 off the pair's middle.
Variation of_rod(Variation change, const Chain& chain, const Mat3& body, Real side);

/// H_ξ of the full level. @param S  n + r rows: ∂q_e/∂f of every rod, x held
void parameter_jacobian(const Robot& robot, const FullClosure& at,
                        const Matrix<kMaxReadings, kMaxUnknowns>& S, Real* H);
}  // namespace full_detail

/// q_e, H_x and H_ξ of the full level, as linearise() for the ideal one: D and θ (of a translation
/// robot: D) are held, the platform's tilt and its bars' turns follow.
/// @param rest  as of ikm_full
/// @return also no_full_level (robot.full)
inline Outcome linearise_full(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                              Real* H_xi, Parasitic* rest = nullptr) {
  if (!robot.finished) return {Status::unfinished, -1};
  if (robot.full.kind == FullKind::same) return linearise(robot, pose, q_e, H_x, H_xi);
  if (!robot.full.own()) return {Status::no_full_level, -1};
  const int n = dof(robot.mobility), N = rods_of(robot);
  const auto& columns = free_columns(robot.mobility);
  FullClosure at;
  std::array<FullRow, kMaxSensors> rows;
  const Outcome outcome = extended_full(robot, pose, q_e, at, rows, rest);
  if (!outcome) return outcome;

  for (int rod = 0; rod < N; ++rod)
    if (full_detail::stretched(at, rod)) return {Status::singular, rod / 2};
  const full_detail::Inverse inverse{robot};
  const full_detail::Factors factors(inverse, at, 0);
  if (!factors.regular()) return {Status::singular, -1};

  Matrix<kMaxSensors, kMaxUnknowns> e_y;
  for (int k = 0; k < robot.r; ++k) {
    e_y[k].fill(0);
    if (on_chain(robot.sensor[k])) e_y[k][robot.sensor[k].chain] = rows[k].motor;
    FullRow& row = rows[k];
    if (robot.full.kind == FullKind::elastic) {
      row.z[6] += row.z[7];
      row.z[7] = 0;  // stress is no motion
    }
    inverse.hidden(at.pose.R, row.z, e_y[k]);
  }

  Matrix<kMaxReadings, kMaxUnknowns> S;
  for (int rod = 0; rod < N; ++rod) {
    const Unknowns y = factors.square.column(rod, 1);
    for (int i = 0; i < n; ++i) S[i][rod] = y[i];
    for (int k = 0; k < robot.r; ++k)
      S[n + k][rod] = sum_of(N, [&](int j) { return e_y[k][j] * y[j]; });
  }

  // Along x the free columns of the motion: a turn about z has θ̇ = 1 at any tilt.
  for (int i = 0; i < n; ++i) H_x[i].fill(0);
  for (int k = 0; k < robot.r; ++k)
    for (int j = 0; j < n; ++j) H_x[n + k][j] = rows[k].z[columns[j]];
  for (int rod = 0; rod < N; ++rod) {
    Unknowns row;
    full_row(robot, at, rod, row);
    for (int e = 0; e < n + robot.r; ++e)
      for (int j = 0; j < n; ++j) H_x[e][j] -= S[e][rod] * row[columns[j]];
  }
  if (H_xi) full_detail::parameter_jacobian(robot, at, S, H_xi);
  return {};
}

/// The level whose rods a robot's laws model.
inline Level level_of(const Robot& robot) {
  return robot.rod_by_rod() ? Level::full : Level::ideal;
}

/// q_e, H_x and H_ξ of a level. @param rest  as of ikm_full
inline Outcome linearise(Level level, const Robot& robot, const Pose& pose, Extended& q_e,
                         PoseRows& H_x, Real* H_xi, Parasitic& rest) {
  return level == Level::full ? linearise_full(robot, pose, q_e, H_x, H_xi, &rest)
                              : linearise(robot, pose, q_e, H_x, H_xi);
}

/// The motors' pose at a level, where another search starts. @param rest  as of ikm_full
Status motors_pose(Level level, const Robot& robot, const Joint& q, Pose& pose, Parasitic& rest);
}  // namespace truepose
