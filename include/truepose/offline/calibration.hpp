// Input and output of a batch calibration.
#pragma once

#include <functional>
#include <vector>

#include "truepose/offline/links.hpp"

namespace truepose {

/// How a batch calibration is done.
struct CalibrationSettings {
  int influences = 0;     ///< how many unknowns before the nuisances are amounts of influences
  int nuisances = 0;      ///< how many of the prior's last parameters are left_out's, independent
  int registration = -1;  ///< first of the prior's kRegistration unknowns of a registration, or -1
  Loss loss = Loss::squares;
  double tuning = 0;
  int iterations = 100;
  std::function<void()>
      poll;  ///< called after every line, if there is one; may throw to end it all
};

/// Readings at poses nobody knows; where somebody does, what was measured there. NaN: not read.
struct ReadingLog {
  int count = 0;
  const double* q_e = nullptr;             ///< count × (n + r)
  const double* influence = nullptr;       ///< count × (n + r) × influences: what one unit adds
  const double* measured = nullptr;        ///< count × n coordinates, or nullptr
  const double* measured_sigma = nullptr;  ///< of those, > 0
  Registration registration{};  ///< of those; the marker to begin with where it is unknown
  Links links{};                ///< differences that were measured between its poses
  int referenced = 0;  ///< so many of the last lines were measured in the base frame; no outliers
};

/// What a calibration makes of one measured difference, in its own unit. NaN: of a line that was
/// left out.
struct LinkResult {
  double residual = NAN;  ///< measured less expected, everything counted
  double left_out = NAN;  ///< the same where all but this one counts, to first order
  double sigma = NAN;     ///< of that
  double weight = 0;      ///< 1, or less where it is an outlier
};

/// What a batch calibration found, line by line of the log and in all.
struct CalibrationResult {
  Outcome outcome;
  int iterations = 0;
  std::vector<double> xi;      ///< parameter_count(drawn) values
  Eigen::VectorXd u;           ///< ξ̂ of the uncertain ones: μ + S u
  Eigen::MatrixXd covariance;  ///< of the uncertain parameters, nuisances left out
  Registration start;          ///< what the registration's unknowns are steps from
  Registration registration;
  std::vector<Pose> pose;        ///< x̂ of every line of the log
  std::vector<Status> status;    ///< of every line; one that is not ok was left out
  std::vector<double> chi2;      ///< d² of every line
  std::vector<int> redundancy;   ///< equations that a line leaves over for ξ
  std::vector<double> weight;    ///< of every line: 1, or less where it is an outlier
  std::vector<LinkResult> link;  ///< of every measured difference
  std::vector<double> w;         ///< the unknowns of those
  std::vector<double> amount;    ///< of every influence
  double cost = 0;
};

}  // namespace truepose
