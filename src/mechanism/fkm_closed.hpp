// The forward kinematic model in closed form where the orientation is known: D is on m spheres.
#pragma once

#include "mechanism/chain.hpp"

namespace truepose {
/// Computes the platform's position from the motors and its orientation (measured, or fixed for a
/// translation robot), from all m ≥ 3 spheres |D - s_i| = L_i, s_i = B_i - R c_i - a_i.
///
/// With y = D - s̄, t_i = s_i - s̄, the mean sphere is |y|² = mean(L² - |t|²) and each sphere minus
/// the mean is linear: t_i·y = g_i. In least squares T y = Σ t_i g_i, T = Σ t_i t_iᵀ. T has rank 2
/// where the centres are coplanar: with three chains, and for an H4 at θ = 0 (two of its four
/// centres coincide). The coordinate along its weakest direction m therefore always comes from the
/// mean sphere, the others from the linear equations: exact for consistent readings, at every θ.
///
/// @param R          orientation, platform to base
/// @param near_side  a point on the platform's side of the centres' plane (its home)
/// @param D          out
/// @return singular: the centres are on one line; unreachable: the spheres do not meet
Outcome fkm_closed(const Robot& robot, const Joint& q, const Mat3& R, const Vec3& near_side,
                   Vec3& D);
}  // namespace truepose
