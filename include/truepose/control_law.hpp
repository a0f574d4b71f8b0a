// What motor error do the readings mean? The paper's three answers, from one reference.
#pragma once

#include "truepose/fkm_closed.hpp"
#include "truepose/tej.hpp"

namespace truepose {

enum class Law : int {
  joint = 0,      ///< Figure 1: e_q = q_d - q
  redundant = 1,  ///< Figure 2: ê_q = TEJ (q_de - q_e)
  cartesian = 2,  ///< closing remark: ê_q = J⁻¹ (x_d - x̂), x̂ from the redundant FKM
};

/// Everything a law needs that depends on x_d alone: q_de, J, TEJ at x_d, q_d.
template <Mobility K>
struct Reference {
  Closure<K> closure;
  Jacobians<K> jacobians;
  Reading r;
  Matrix<kMaxSensors, kDof<K>> jr;
  ExtendedColumns M;
  ExtendedRows tej;
};

/// @param band  conditioning below which J and J⁻¹ are damped (0: nowhere, the paper's law)
/// @return near_singular where they are; joint_limit where a motor would have to pass its stops;
/// branch_lost where x_d lies in another assembly mode than
/// the robot's home (in the band, where the modes meet, both are its own)
template <Mobility K>
inline Outcome refer(const Robot& robot, Law law, const Joint& x_d, Reference<K>& reference,
                     double band = 0) {
  Outcome outcome = ikm<K>(robot, to_pose<K>(x_d), reference.closure);
  if (outcome) outcome = within_limits(robot, reference.closure.q());
  if (outcome) outcome = jacobian<K>(reference.closure, band, reference.jacobians);
  const Outcome regular = outcome;
  if (outcome) outcome = rkm<K>(robot, reference.closure, reference.r, reference.jr);
  // On the other side of a singularity the motors would have to pass through it to get there.
  const bool modes_meet = regular.status == Status::near_singular && regular.chain < 0;
  if (outcome && !modes_meet && robot.assembly_sign != 0 &&
      assembly_sign<K>(reference.jacobians) != robot.assembly_sign)
    outcome = {Status::branch_lost, -1};
  if (!outcome) return outcome;
  if (law == Law::redundant)
    tej<K>(robot, reference.jacobians, reference.jr, reference.M, reference.tej);
  return regular;
}

/// Redundant FKM: orientation from its sensor (or fixed by the mobility), position from all
/// spheres. @return not_measured where no sensor gives the orientation
template <Mobility K>
inline Outcome redundant_fkm(const Robot& robot, const Extended& q_e, const Vec3& near_side,
                             Pose& pose) {
  if constexpr (K == Mobility::schoenflies || K == Mobility::translation) {
    pose = Pose{};
    if constexpr (K == Mobility::schoenflies) {
      int k = 0;
      while (k < robot.r && robot.sensor[k].kind != SensorKind::nacelle_angle) ++k;
      if (k == robot.r) return {Status::not_measured, -1};
      pose.theta = measured(robot.sensor[k], q_e[kDof<K> + k]);
      pose.R = rotation_z(pose.theta);
    }
    Joint q{};
    for (int i = 0; i < kDof<K>; ++i) q[i] = q_e[i];
    return fkm_closed<K>(robot, q, pose.R, near_side, pose.D);
  } else {
    return {Status::not_measured, -1};
  }
}

/// The same for coordinates x of any mobility; the robot's home says on which side the nacelle is.
inline Outcome redundant_fkm(const Robot& robot, const Extended& q_e, Joint& x) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Pose pose;
    const Outcome outcome = redundant_fkm<K>(robot, q_e, to_pose<K>(robot.home).D, pose);
    if (outcome) x = to_coordinates<K>(pose);
    return outcome;
  });
}

/// Motor error under a law. @param estimate  out, Cartesian law only: x̂
template <Mobility K>
inline Outcome motor_error(const Robot& robot, Law law, const Reference<K>& reference,
                           const Extended& q_e, Joint& error, Pose& estimate) {
  constexpr int n = kDof<K>;
  if (law == Law::cartesian) {
    const Outcome outcome = redundant_fkm<K>(robot, q_e, reference.closure.pose.D, estimate);
    if (outcome)
      error = reference.jacobians.joint_rate(difference<K>(reference.closure.pose, estimate));
    return outcome;
  }
  std::array<double, kMaxReadings> e_qe;
  for (int i = 0; i < n; ++i) e_qe[i] = reference.closure.chain[i].q - q_e[i];
  if (law == Law::joint) {
    for (int i = 0; i < n; ++i) error[i] = e_qe[i];
  } else {
    for (int k = 0; k < robot.r; ++k) e_qe[n + k] = reference.r[k] - q_e[n + k];
    for (int i = 0; i < n; ++i) {
      error[i] = 0;
      for (int c = 0; c < n + robot.r; ++c) error[i] += reference.tej[i][c] * e_qe[c];
    }
  }
  return {};
}

}  // namespace truepose
