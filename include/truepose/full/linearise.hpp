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

#include "truepose/estimation/estimate.hpp"
#include "truepose/full/rkm.hpp"
#include "truepose/kinematics/fkm.hpp"

namespace truepose {
namespace full_detail {
/// Variation of one rod of a pair: its ends are ±s/2 off the pair's middle.
inline Variation of_rod(Variation change, const Chain& chain, const Mat3& body, Real side) {
  const Vec3 u = pair_direction(chain);
  change.B += 0.5 * side * (chain.rod_spacing * change.turn.cross(u) + change.spacing * u);
  change.A += 0.5 * side * change.spacing * (body * chain.pair_drawn());
  change.rod += 0.5 * side * change.difference;
  return change;
}

/// H_ξ of the full level. @param S  n + r rows: ∂q_e/∂f of every rod, x held
template <Mobility K>
inline void parameter_jacobian(const Robot& robot, const FullClosure<K>& at,
                               const Matrix<kMaxReadings, kRods<K>>& S, Real* H) {
  constexpr int n = kDof<K>;
  const int width = parameter_count(robot), readings = n + robot.r;
  std::fill(H, H + readings * width, 0.0);
  std::array<Sensed, kMaxSensors> sensed;
  for (int k = 0; k < robot.r; ++k) sensed[k] = sense_full<K>(robot, robot.sensor[k], at);

  for (int i = 0; i < n; ++i) {
    const Chain& chain = robot.chain[i];
    const Driven& driven = at.driven[i];
    const Mat3 body = body_of(chain, at.pose);
    const auto enter = [&](int column, const Variation& change) {
      for (const int side : {1, -1}) {
        const int rod = 2 * i + (side < 0);
        const Variation own = of_rod(change, chain, body, side);
        const Real f = closure_change(at.v[rod], at.jq[rod], rod_length(chain, driven, side), own);
        for (int e = 0; e < readings; ++e) H[e * width + column] += S[e][rod] * f;
        for (int k = 0; k < robot.r; ++k) {
          const Sensor& sensor = robot.sensor[k];
          if (sensor.chain == i && rod_of(sensor) == rod)
            H[(n + k) * width + column] +=
                sensor.gain * sensor_change(sensor, sensed[k], chain, driven.dB, driven.rate, own);
        }
      }
    };
    for_each_variation(robot, i, at.q[i], driven.p, body, at.pose.R * chain.pivot(), enter);
  }
  sensor_columns(robot, sensed, H);
}
}  // namespace full_detail

/// q_e, H_x and H_ξ of the full level, as linearise() for the ideal one: D and θ (of a translation
/// robot: D) are held, the platform's tilt and its bars' turns follow.
/// @param rest  as of ikm_full
/// @return also no_full_level (robot.full)
template <Mobility K>
Outcome linearise_full(const Robot& robot, const Pose& pose, Extended& q_e,
                       Matrix<kMaxReadings, kDof<K>>& H_x, Real* H_xi, Parasitic* rest = nullptr) {
  if (!robot.finished) return {Status::unfinished, -1};
  if constexpr (!kRodByRod<K>) {
    if (robot.full.kind != FullKind::same) return {Status::no_full_level, -1};
    return linearise<K>(robot, pose, q_e, H_x, H_xi);
  } else {
    using Inverse = full_detail::Inverse<K>;
    constexpr int n = kDof<K>, N = kRods<K>;
    if (!robot.full.own()) return {Status::no_full_level, -1};
    FullClosure<K> at;
    std::array<FullRow, kMaxSensors> rows;
    const Outcome outcome = extended_full<K>(robot, pose, q_e, at, rows, rest);
    if (!outcome) return outcome;

    for (int rod = 0; rod < N; ++rod)
      if (full_detail::stretched<K>(at, rod)) return {Status::singular, rod / 2};
    const full_detail::Factors<K> factors(Inverse{robot}, at, 0);
    if (!factors.regular()) return {Status::singular, -1};

    Matrix<kMaxSensors, N> e_y;
    for (int k = 0; k < robot.r; ++k) {
      e_y[k].fill(0);
      if (on_chain(robot.sensor[k])) e_y[k][robot.sensor[k].chain] = rows[k].motor;
      FullRow& row = rows[k];
      if (robot.full.kind == FullKind::elastic) {
        row.z[6] += row.z[7];
        row.z[7] = 0;  // stress is no motion
      }
      Inverse::hidden(at.pose.R, row.z, e_y[k]);
    }

    Matrix<kMaxReadings, N> S;
    for (int rod = 0; rod < N; ++rod) {
      const full_detail::Column<K> y = factors.square.column(rod, 1);
      for (int i = 0; i < n; ++i) S[i][rod] = y[i];
      for (int k = 0; k < robot.r; ++k) {
        Real sum = 0;
        for (int j = 0; j < N; ++j) sum += e_y[k][j] * y[j];
        S[n + k][rod] = sum;
      }
    }

    // Along x the free columns of the motion: a turn about z has θ̇ = 1 at any tilt.
    for (int i = 0; i < n; ++i) H_x[i].fill(0);
    for (int k = 0; k < robot.r; ++k)
      for (int j = 0; j < n; ++j) H_x[n + k][j] = rows[k].z[Freedom<K>::columns[j]];
    for (int rod = 0; rod < N; ++rod) {
      std::array<Real, kMaxUnknowns> row;
      full_row<K>(robot, at, rod, row);
      for (int e = 0; e < n + robot.r; ++e)
        for (int j = 0; j < n; ++j) H_x[e][j] -= S[e][rod] * row[Freedom<K>::columns[j]];
    }
    if (H_xi) full_detail::parameter_jacobian<K>(robot, at, S, H_xi);
    return {};
  }
}

/// Model of an estimate with every rod by itself (estimate.hpp has the ideal one).
struct FullModel {
  template <Mobility K>
  static Outcome linearise(const Robot& robot, const Pose& pose, Extended& q_e,
                           Matrix<kMaxReadings, kDof<K>>& H_x, Real* H_xi, Parasitic& rest) {
    return linearise_full<K>(robot, pose, q_e, H_x, H_xi, &rest);
  }
  template <Mobility K>
  static Status fkm(const Robot& robot, const Joint& q, Pose& pose, Parasitic& rest) {
    if constexpr (!kRodByRod<K>) {  // the levels coincide
      return truepose::fkm<K>(robot, q, pose, kFkmStart).status;
    } else {
      FullPose full = rest.beside(pose);
      FullClosure<K> closure;
      const Status status = fkm_full<K>(robot, q, full, closure, kFkmStart).status;
      if (status == Status::ok) {  // D and θ are the coordinates; tilt and bars follow from them
        pose = full;
        pose.R = kTurnsAboutZ<K> ? rotation_z(pose.theta) : Mat3(Mat3::Identity());
        Closure<K> ideal;
        if (ikm<K>(robot, pose, ideal)) rest = beyond_ideal<K>(closure, pose, ideal.q());
      }
      return status;
    }
  }
};

/// Calls f with the model of a robot's level.
template <Mobility K, class F>
inline auto with_model(const Robot& robot, F&& f) {
  if constexpr (kRodByRod<K>)
    if (robot.rod_by_rod()) return f(FullModel{});
  return f(IdealModel{});
}
}  // namespace truepose
