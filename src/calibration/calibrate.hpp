// Maximum a posteriori estimate of ξ from a robot's own readings.
//
// Minimises |u|² + Σ_k d_k² over ξ = μ + S u and every pose x_k, where d_k² is the residual of the
// readings at the best pose k, of all rows but outliers. Poses are eliminated (eliminate.hpp), so
// that a step solves for ξ alone: (I + Σ w RᵀR) δu = Σ w Rᵀy - u; each δx_k follows. Measured
// differences between poses add rows (links.hpp).
#pragma once

#include <functional>
#include <vector>

#include "calibration/evidence.hpp"
#include "calibration/links.hpp"

namespace truepose {
/// Influence of gross errors: almost none, or all.
enum class Loss : int { student = 0, squares = 1 };

/// Settings of a batch calibration.
struct CalibrationSettings {
  int influences = 0;     ///< number of amounts of influences, unknowns before the nuisances
  int nuisances = 0;      ///< number of the prior's last parameters, for left_out; independent
  int registration = -1;  ///< first of the prior's kRegistration registration unknowns, or -1
  Loss loss = Loss::student;
  int iterations = 100;
  bool rows = false;           ///< whether the result has its rows
  std::function<void()> poll;  ///< called after every row, if set; may throw to abort
};

/// Readings at unknown poses, with any external measurements there. NaN: not read.
struct ReadingLog {
  int count = 0;
  const double* q_e = nullptr;             ///< count × (n + r)
  const double* influence = nullptr;       ///< count × (n + r) × influences: effect of one unit
  const double* measured = nullptr;        ///< count × n coordinates, or nullptr
  const double* measured_sigma = nullptr;  ///< σ of those, > 0
  Registration registration{};             ///< of those; initial marker where it is unknown
  Links links{};                           ///< measured differences between its poses
  int referenced = 0;  ///< number of last rows, measured in the base frame; never outliers
};

/// Result of a batch calibration, by row of the log and overall.
struct CalibrationResult {
  Outcome outcome;
  int iterations = 0;
  std::vector<double> xi;  ///< parameter_count(drawn) values
  std::vector<double> u;   ///< ξ̂ of the uncertain ones: μ + S u
  RowMatrix covariance;    ///< of the uncertain parameters, nuisances left out
  Registration start;      ///< registration at zero unknowns
  Registration registration;
  std::vector<Pose> pose;        ///< x̂ of every row of the log
  std::vector<Status> status;    ///< of every row; one that is not ok was excluded
  std::vector<double> chi2;      ///< d² of every row
  std::vector<int> redundancy;   ///< equations of a row that remain for ξ
  std::vector<double> weight;    ///< of every row: 1, or 0 for an outlier
  std::vector<LinkResult> link;  ///< of every measured difference
  std::vector<double> w;         ///< the unknowns of those
  std::vector<double> amount;    ///< of every influence
  double cost = 0;
  LogRows rows;  ///< at the end, if asked for
};

/// Batch calibration by Levenberg-Marquardt; deterministic. Where least squares leave a row that
/// all others contradict (CalibrationIterate::outliers), the search begins again by Student's loss
/// of residuals in units of their median, which then decreases: the initial error is no outlier,
/// and gross errors never enter as squares. Then the outliers are left out, and least squares of
/// the others decide again about every row, until no decision changes.
/// @param mean  of ξ, parameter_count(drawn) values
CalibrationResult calibrate(Level level, const Robot& drawn, const Knowledge& prior,
                            const std::vector<double>& mean, const ReadingLog& log,
                            const CalibrationSettings& settings);
}  // namespace truepose
