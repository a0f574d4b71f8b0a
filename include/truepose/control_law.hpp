// What motor error do the readings mean? The paper's three answers and two that weigh the readings
// by what is known of them, from one reference.
#pragma once

#include "truepose/estimate.hpp"
#include "truepose/fkm_closed.hpp"
#include "truepose/tej.hpp"

namespace truepose {

enum class Law : int {
  joint = 0,      ///< Figure 1: e_q = q_d - q
  redundant = 1,  ///< Figure 2: ê_q = TEJ (q_de - q_e)
  cartesian = 2,  ///< closing remark: ê_q = J⁻¹ (x_d - x̂), x̂ from the redundant FKM
  weighted = 3,   ///< as redundant, with the weighted TEJ (estimate.hpp)
  estimated = 4,  ///< as cartesian, x̂ from `estimate`: any mobility, any sensors
};

/// Whether the law corrects a pose x̂, and whether it maps all readings by a TEJ.
constexpr bool of_pose(Law law) { return law == Law::cartesian || law == Law::estimated; }
constexpr bool of_readings(Law law) { return law == Law::redundant || law == Law::weighted; }

/// What the last two laws need besides the robot. One for each controller that runs at a time: the
/// work space is written to.
struct Weighing {
  const Knowledge* known = nullptr;  ///< about the robot's own parameter values
  double* work = nullptr;            ///< estimate_work(robot, known->count) doubles
  explicit operator bool() const { return known != nullptr && work != nullptr; }
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

/// Weighted TEJ at the reference's pose: M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹, C of the robot's own geometry there.
template <Mobility K>
TRUEPOSE_APART inline Outcome weigh(const Robot& robot, const Weighing& weighing,
                                    Reference<K>& reference) {
  if (!weighing) return {Status::not_measured, -1};
  constexpr int n = kDof<K>;
  Matrix<kMaxReadings, n> H_x;
  ReadingCovariance C;
  Fusion<K> fusion;
  double *H_xi = weighing.work, *B = H_xi + (n + robot.r) * parameter_count(robot);
  pose_rows<K>(robot, reference.jacobians, reference.jr, H_x);
  parameter_jacobian<K>(robot, reference.closure, H_xi);
  Outcome outcome = reading_covariance(robot, *weighing.known, H_xi, B, C);
  if (outcome) outcome = fuse<K>(robot, *weighing.known, C, H_x, fusion);
  if (outcome) weighted_tej<K>(robot, H_x, fusion, reference.tej);
  return outcome;
}

/// @param band  conditioning below which J and J⁻¹ are damped (0: nowhere, the paper's law)
/// @param weighing  for the weighted law
/// @return near_singular where they are; joint_limit where a motor would have to pass its stops;
/// branch_lost where x_d lies in another assembly mode than
/// the robot's home (in the band, where the modes meet, both are its own)
template <Mobility K>
inline Outcome refer(const Robot& robot, Law law, const Joint& x_d, Reference<K>& reference,
                     double band = 0, const Weighing& weighing = {}) {
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
  else if (law == Law::weighted)
    outcome = weigh<K>(robot, weighing, reference);
  return outcome ? regular : outcome;
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

/// x̂ of all readings, searched for from where it is asked to be.
template <Mobility K>
TRUEPOSE_APART inline Outcome find(const Robot& robot, const Weighing& weighing,
                                   const Pose& desired, const Extended& q_e, Pose& found) {
  if (!weighing) return {Status::not_measured, -1};
  found = desired;
  return estimate<K>(robot, *weighing.known, q_e, found, weighing.work).outcome;
}

/// Motor error under a law.
/// @param found     out, laws of the pose only: x̂
/// @param weighing  for the law of the estimate
template <Mobility K>
inline Outcome motor_error(const Robot& robot, Law law, const Reference<K>& reference,
                           const Extended& q_e, Joint& error, Pose& found,
                           const Weighing& weighing = {}) {
  constexpr int n = kDof<K>;
  if (of_pose(law)) {
    const Outcome outcome = law == Law::cartesian
                                ? redundant_fkm<K>(robot, q_e, reference.closure.pose.D, found)
                                : find<K>(robot, weighing, reference.closure.pose, q_e, found);
    if (outcome)
      error = reference.jacobians.joint_rate(difference<K>(reference.closure.pose, found));
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
