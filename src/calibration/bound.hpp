// The (Bayesian, linear-Gaussian) Cramér-Rao bound of the pose.
#pragma once

#include <functional>
#include <vector>

#include "calibration/links.hpp"

namespace truepose {
/// A pose at which readings are taken, and other information on it.
struct Visit {
  Pose pose;
  Outside outside;
  Influences influences{};
};

/// Information of visits on ξ: rows y = B δξ + ε of unit noise, the poses eliminated. With u the
/// parameters in units of the prior's root S, Σ_u⁻¹ = I + SᵀBᵀB S afterwards.
struct VisitRows {
  RowMatrix B;             ///< per unit of each parameter (m, rad, one)
  std::vector<int> visit;  ///< visit of each row; for a link the first of its block
};

/// Computes the rows of readings at these poses, unknown apart from external measurements.
/// @param prior  of ξ, its auxiliary unknowns, then the amounts of influences and `nuisances` model
///               errors of the ideal level; its root is not used
/// @param links  differences measured between these poses; their unknowns follow ξ
/// @param poll   called after every pose; may throw to abort
/// @return the first outcome that is not ok; `chain` is then the faulty chain
Outcome rows_of_visits(
    Level level, const Robot& robot, const Knowledge& prior, int nuisances,
    const std::vector<Visit>& visits, const Links& links, VisitRows& all,
    const std::function<void()>& poll = [] {});

/// Generalised least squares at a pose, as Fusion, and the resulting weighted TEJ.
struct Fused : Fusion {
  ExtendedRows tej;
};

/// Computes the fusion of all readings at a pose, with the weights of that pose.
/// @param acting   influences, whose amounts are the last known quantities
/// @param H_xi, B  work space, as for reading_covariance
Outcome fused(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
              const Influences& acting, double* H_xi, double* B, Fused& fusion);

/// Errors of x̂ at a pose: due to ξ, in units of the knowledge's root, and due to the readings.
struct PoseError {
  RowMatrix by_geometry;  ///< n×p
  RowMatrix by_noise;     ///< covariance, n×n
};

Outcome pose_error(Level level, const Robot& robot, const Knowledge& known, const Pose& pose,
                   const Influences& acting, std::vector<double>& work, PoseError& error);
}  // namespace truepose
