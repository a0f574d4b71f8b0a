// One row of readings as linear equations in ξ, with its pose eliminated.
#pragma once

#include "calibration/dense.hpp"
#include "calibration/loss.hpp"
#include "calibration/registration.hpp"
#include "estimation/row.hpp"

namespace truepose {
/// A row with its pose eliminated. For u in units of the knowledge's root: ξ = μ + S u.
struct Line : ReadingRow {
  RowMatrix B;
  Coordinates pull{};  ///< from other data on the pose (links.hpp): its best is at e = -pull

  bool certain = false;  ///< never an outlier: its pose is known
  bool outlier = false;  ///< does not count

  int redundancy() const { return max(rows - n, 0); }
  double chi2() const;
  /// Squared residual at its pose; chi2() is that of the best pose, to first order.
  double misfit() const;
  /// Distance of its pose from the best pose, in units of its σ.
  double away() const;
  /// Within σ of the best pose chi2() is exact enough; misfit() would add the pose's lag behind ξ,
  /// which hides the gain of a step where σ is small and steps are not.
  double d2() const { return away() < 1 ? chi2() : misfit(); }
  double cost(const RowLoss& loss) const;
  double weight(const RowLoss& loss) const;
  /// d² of its error predicted by all other rows: χ² of redundancy() degrees of freedom.
  /// @param root  of the information on u by all rows that count, squares
  double left_out(const RowMatrix& root) const;
};

/// Registration of a tracker that measures x in the base frame.
inline const Registration kAligned{};

/// External measurement at a row's pose: some coordinates, the others NaN.
struct Outside {
  const double* x = nullptr;      ///< n coordinates; nullptr: none
  const double* sigma = nullptr;  ///< n, > 0
  const Registration* registration = &kAligned;
  int first = -1;  ///< of the registration among the unknowns; -1: known
};

/// Other influences on the readings at a pose, of unknown amounts.
struct Influences {
  int count = 0;
  const double* pattern = nullptr;  ///< (m + r) × count: effect of one unit of each
};

/// Computes D of a row, in σ of the readings: of influences, then of η, the model error of the
/// ideal level. Axes that deviate from nominal tilt the platform and turn its bars; readings then
/// differ by D η to first order, with D = H_ξ(full) - H_ξ(ideal).
/// @param axes  columns of H_ξ of η; σ of the readings
/// @param H_xi  work space, 2 (m + r) × parameter_count
Outcome acting(const Robot& robot, const Knowledge& axes, const Pose& pose, const Influences& given,
               double* H_xi, RowMatrix& D);

/// Linearises readings and external measurement at a pose, and eliminates the pose.
/// @param q_e    m + r readings, NaN where missing; nullptr: as expected
/// @param known  ξ, then unknowns that no reading depends on, column -1, then η
/// @param D      ∂q_e/∂η in units of the readings' σ, from acting; empty: no η
/// @param H_xi   work space, 2 (m + r) × parameter_count. @param rest  as of linearise
Outcome linearise_line(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                       const double* q_e, Outside outside, const RowMatrix& D, double* H_xi,
                       Line& line, Parasitic& rest);
}  // namespace truepose
