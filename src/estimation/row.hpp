// One row of readings as whitened equations, from which the pose can be eliminated.
#pragma once

#include "estimation/estimate.hpp"
#include "math/eliminate.hpp"

namespace truepose {
/// e = H_x δx + B δξ + noise, in units of the readings' σ. After eliminate(): R δx = e - B δξ in
/// the upper n equations; those below contain no δx.
struct ReadingRow {
  int n = 0, rows = 0;
  RowsOfPose R;  ///< H_x
  std::array<Real, kMaxRows> e;
  std::array<int, kMaxReadings> reading;  ///< of each equation
};

/// Linearises the readings at a pose.
/// @param q_e   m + r readings, NaN where missing; nullptr: as expected
/// @param H_xi  work space, (m + r) × parameter_count numbers; nullptr: without B
/// @param B     out: rows × known.count, by each parameter in its own unit, as of gather
/// @param rest  as of linearise
Outcome linearise_row(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                      const Real* q_e, Real* H_xi, Real* B, ReadingRow& row, Parasitic& rest);

/// Rows as `eliminate` leaves them, by an error of one σ of each reading.
/// @param A  H_x @param G  out: rows × rows
bool of_readings(int n, int rows, RowsOfPose A, Real* G);
}  // namespace truepose
