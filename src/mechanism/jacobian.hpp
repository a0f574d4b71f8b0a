// Jacobians between motions of platform and motors: J_x ẋ = J_q q̇, ẋ = J q̇; K = J_q⁻¹ J_x, q̇ = K ẋ.
#pragma once

#include "math/square.hpp"
#include "mechanism/ikm.hpp"

namespace truepose {
/// A row of J_x along the platform's free twists: [vᵀ, (R c × v)ᵀ] S, or a_j·((A - p_j) × v) for a
/// passive axis.
inline void jx_row(const Carried& carried, const Vec3& v, const Vec3& lever, Real* row) {
  free_row(carried, v, lever.cross(v), row);
}

/// Rows scale_i v_i of J_x, and |column|² if nothing cancelled: Σ|v|² for columns of a velocity,
/// Σ|R c|²|v|² for those of a turn, Σ|A - p_j|²|v|² for a passive axis. Where the rods meet in one
/// point, the column of a turn vanishes relative to this size.
Unknowns jx_rows(const Closure& closure, const Joint& scale, Square& rows);
/// J_x itself.
Unknowns jx_rows(const Closure& closure, Square& rows);

/// J_x (m×n), the diagonal of J_q, and J (n×m) at a closed pose: J_x⁻¹ J_q, or with more motors m
/// than freedoms n the pseudo-inverse K⁺ of K = J_q⁻¹ J_x. Both motor rates in least squares, ẋ = J
/// q̇, and motor torques of least norm for a wrench of the platform, τ = Jᵀ w, have this J.
struct Jacobians {
  int n, motors;
  Square jx, J;
  Joint jq;
  /// Of det J_x: poses with equal q and different sign are in different assembly modes. 0 with more
  /// motors than freedoms: J_x then keeps its rank along a path between two modes.
  int sign = 0;

  /// q̇ = J⁻¹ ẋ = J_q⁻¹ J_x ẋ, without an inverse of J.
  Joint joint_rate(const Coordinates& rate) const {
    Joint result{};
    for (int i : range(motors))
      result[i] = sum_of(n, [&](int j) { return jx[i][j] * rate[j]; }) / jq[i];
    return result;
  }
};

/// K = J_q⁻¹ J_x. @return the sizes of its columns, as jx_rows()
Unknowns inverse_rows(const Closure& closure, Square& K);

/// Computes J_x, J_q and J at a closed pose.
/// @return singular where J_x loses rank (type 2: the motors do not hold the platform) or an entry
/// of J_q vanishes (type 1: the arm of `chain` is stretched or folded), with J_x and J_q.
Outcome jacobian(const Closure& closure, Jacobians& jacobians);

/// The same at any pose. @param angle  as of ikm
inline Outcome jacobian_at(const Robot& robot, const Pose& pose, Closure& closure,
                           Jacobians& jacobians, bool angle = true) {
  const Outcome outcome = ikm(robot, pose, closure, angle);
  return outcome ? jacobian(closure, jacobians) : outcome;
}

/// Twist J v of the platform for rates v of the readings.
Coordinates pose_rate(const Jacobians& at, const Joint& rate);

/// J alone, n×m.
Outcome jacobian(const Robot& robot, const Closure& closure, JointMatrix& J);

/// Whether a determinant's sign differs from that at home, which proves another assembly mode. An
/// equal sign proves nothing: a robot may have two regions of one sign.
/// @param home  sign at home; 0: not checked
/// @param sign  -1, 0 (between two modes) or 1
constexpr bool other_mode(int home, int sign) { return home != 0 && sign != home; }

/// Derives assembly_sign from the present geometry; unchanged where home is out of its reach.
/// @return the outcome at home: unreachable, singular, joint_limit
Outcome note_assembly(Robot& robot);

/// Checks a robot's counts, indices and enums, and derives assembly_sign, limited, encoder_errs and
/// the inclinometers' vertical. Call it after building a robot and after every change.
/// A robot with a singular or unreachable home is finished, too: its assembly mode is unchecked.
/// @return no_such_part, not_square (fewer motors than freedoms or chains): refused, still
/// unfinished; or the outcome at home: unreachable, singular, joint_limit
Outcome finish(Robot& robot);
}  // namespace truepose
