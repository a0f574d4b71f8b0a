// Which geometry explains a robot's own readings? The maximum a posteriori estimate of ξ.
//
// Minimises |u|² + Σ_k ρ(d_k²) over ξ = μ + S u and every pose x_k, where d_k² is what the readings
// at pose k still disagree about once the best pose is taken. Poses are eliminated (eliminate.hpp),
// so that a step solves for ξ alone: (I + Σ w RᵀR) δu = Σ w Rᵀy - u, then each δx_k follows.
#pragma once

#include <Eigen/Cholesky>
#include <vector>

#include "truepose/eliminate.hpp"
#include "truepose/estimate.hpp"
#include "truepose/geometry.hpp"

namespace truepose {

/// What a disagreement between the readings of one pose costs.
enum class Loss : int {
  squares = 0,  ///< d²: normal errors
  huber = 1,    ///< linear beyond `tuning`
  student = 2,  ///< (ν + r) log(1 + d²/ν), ν = `tuning`: gross errors count for nothing
};

struct CalibrationSettings {
  Loss loss = Loss::squares;
  double tuning = 0;
  int iterations = 100;
};

/// Readings at poses nobody knows; where somebody does, what was measured there. NaN: not read.
struct ReadingLog {
  int count = 0;
  const double* q_e = nullptr;       ///< count × (n + r)
  const double* measured = nullptr;  ///< count × n coordinates, or nullptr
  Joint measured_sigma{};            ///< of those, > 0
};

struct CalibrationResult {
  Outcome outcome;
  int iterations = 0;
  std::vector<double> xi;        ///< parameter_count(drawn) values
  Eigen::MatrixXd covariance;    ///< of the uncertain ones, count×count
  std::vector<Pose> pose;        ///< x̂ of every line of the log
  std::vector<Status> status;    ///< of every line; one that is not ok was left out
  std::vector<double> residual;  ///< count × (n + r), q_e - h(x̂, ξ̂); NaN where not read
  std::vector<double> chi2;      ///< d² of every line
  std::vector<int> redundancy;   ///< equations that a line leaves over for ξ
  std::vector<double> weight;    ///< of every line: 1, or less where it is an outlier
  double cost = 0;
};

/// Batch calibration. Levenberg-Marquardt; the same on every run.
/// A robust loss is reached from the squares: residuals first count in units of their median, so
/// that the geometry's own error does not look like one big outlier.
template <Mobility K, class Level>
class Calibrator {
  static constexpr int n = kDof<K>;

 public:
  Calibrator(const Robot& drawn, const Knowledge& prior, const std::vector<double>& mean,
             const ReadingLog& log, const CalibrationSettings& settings)
      : drawn_(drawn),
        prior_(prior),
        mean_(mean),
        log_(log),
        settings_(settings),
        robot_(drawn),
        p_(prior.count),
        readings_(n + drawn.r),
        S_(Eigen::Map<const RowMatrix>(prior.root, p_, p_)) {}

  CalibrationResult run() {
    CalibrationResult result;
    Iterate now{Eigen::VectorXd::Zero(p_), std::vector<Pose>(log_.count)};
    result.status = start(now);
    scale_ = 1;
    const bool usable = std::count(result.status.begin(), result.status.end(), Status::ok) > 0;
    if (!usable) {
      result.outcome = {Status::unreachable, -1};
      return result;
    }
    for (int bad; (bad = evaluate(now, result.status)) >= 0;) result.status[bad] = Status::singular;
    loss_ = Loss::squares;
    descend(now, result);
    if (settings_.loss != Loss::squares && result.outcome) {
      loss_ = settings_.loss;
      do {  // graduated: from what the median calls normal, down to the stated σ
        scale_ = std::max(1.0, std::min(scale_ == 1 ? INFINITY : 0.5 * scale_, spread(now)));
        descend(now, result);
      } while (scale_ > 1 && result.outcome);
    }
    finish(now, result);
    return result;
  }

 private:
  /// A geometry and its poses; what the readings say there, each line eliminated.
  struct Iterate {
    Eigen::VectorXd u;
    std::vector<Pose> pose;
    std::vector<Matrix<kMaxRows, n>> R{};
    std::vector<std::array<double, kMaxRows>> e{};
    std::vector<RowMatrix> B{};  ///< H_ξ S, whitened and reflected
    std::vector<int> rows{};
    std::vector<double> chi2{};
  };

  std::vector<double> xi_of(const Eigen::VectorXd& u) const {
    std::vector<double> xi = mean_;
    const Eigen::VectorXd change = S_.template triangularView<Eigen::Lower>() * u;
    for (int k = 0; k < p_; ++k) xi[prior_.column[k]] += change[k];
    return xi;
  }

  const double* line(int k) const { return log_.q_e + k * readings_; }

  /// First poses: from the motors, at the prior mean.
  std::vector<Status> start(Iterate& at) {
    set_parameters(drawn_, mean_.data(), robot_);
    std::vector<Status> status(log_.count, Status::ok);
    Pose guess = to_pose<K>(robot_.home);
    for (int k = 0; k < log_.count; ++k) {
      Joint q{};
      std::copy_n(line(k), n, q.begin());
      at.pose[k] = guess;
      status[k] = Level::template fkm<K>(robot_, q, at.pose[k]);
      if (status[k] != Status::ok) {
        at.pose[k] = guess = to_pose<K>(robot_.home);
        status[k] = Level::template fkm<K>(robot_, q, at.pose[k]);
      }
      if (status[k] == Status::ok) guess = at.pose[k];
    }
    return status;
  }

  /// Linearises and eliminates every good line. @return the first that cannot be, or -1
  int evaluate(Iterate& at, const std::vector<Status>& status) {
    const std::vector<double> xi = xi_of(at.u);
    set_parameters(drawn_, xi.data(), robot_);
    at.R.resize(log_.count);
    at.e.resize(log_.count);
    at.B.resize(log_.count);
    at.rows.assign(log_.count, 0);
    at.chi2.assign(log_.count, 0);
    std::vector<double> H_xi(readings_ * parameter_count(drawn_));
    for (int k = 0; k < log_.count; ++k) {
      if (status[k] != Status::ok) continue;
      Extended q_e{}, expected, residual;
      Matrix<kMaxReadings, n> H_x;
      if (!Level::template linearise<K>(robot_, at.pose[k], expected, H_x, H_xi.data())) return k;
      std::copy_n(line(k), readings_, q_e.begin());
      innovation(robot_, q_e, expected, residual);
      at.B[k].setZero(readings_ + n, p_);
      gather(robot_, prior_, H_xi.data(), readings_, at.B[k].data());
      int rows = 0;
      for (int c = 0; c < readings_; ++c) {
        if (!std::isfinite(residual[c])) continue;
        for (int j = 0; j < n; ++j) at.R[k][rows][j] = H_x[c][j] / prior_.sigma[c];
        if (rows < c) at.B[k].row(rows) = at.B[k].row(c);
        at.e[k][rows++] = residual[c] / prior_.sigma[c];
      }
      if (log_.measured) rows = add_measured(k, at, rows);
      times_root(prior_, rows, at.B[k].data());
      if (rows < n || !eliminate<n>(rows, at.R[k], at.B[k].data(), p_, at.e[k])) return k;
      at.rows[k] = rows;
      for (int i = n; i < rows; ++i) at.chi2[k] += at.e[k][i] * at.e[k][i];
    }
    return -1;
  }

  /// An outside measurement of some coordinates: it sees the pose and nothing else.
  int add_measured(int k, Iterate& at, int rows) const {
    Joint x{};
    bool any = false;
    const Joint own = to_coordinates<K>(at.pose[k]);
    for (int j = 0; j < n; ++j) {
      x[j] = log_.measured[k * n + j];
      any = any || std::isfinite(x[j]);
      if (!std::isfinite(x[j])) x[j] = own[j];
    }
    if (!any) return rows;
    const Joint apart = difference<K>(to_pose<K>(x), at.pose[k]);
    for (int j = 0; j < n; ++j) {
      if (!std::isfinite(log_.measured[k * n + j])) continue;
      at.R[k][rows].fill(0);
      at.R[k][rows][j] = 1 / log_.measured_sigma[j];
      at.B[k].row(rows).setZero();
      at.e[k][rows++] = apart[j] / log_.measured_sigma[j];
    }
    return rows;
  }

  double weight(double chi2, int redundancy) const {
    const double d2 = chi2 / (scale_ * scale_), c = settings_.tuning;
    switch (loss_) {
      case Loss::huber: return d2 > c * c ? c / std::sqrt(d2) : 1;
      case Loss::student: return (c + redundancy) / (c + d2);
      default: return 1;
    }
  }
  double rho(double chi2, int redundancy) const {
    const double s2 = scale_ * scale_, d2 = chi2 / s2, c = settings_.tuning;
    switch (loss_) {
      case Loss::huber: return s2 * (d2 > c * c ? 2 * c * std::sqrt(d2) - c * c : d2);
      case Loss::student: return s2 * (c + redundancy) * std::log1p(d2 / c);
      default: return chi2;
    }
  }
  double cost(const Iterate& at) const {
    double sum = at.u.squaredNorm();
    for (int k = 0; k < log_.count; ++k)
      if (at.rows[k] > n) sum += rho(at.chi2[k], at.rows[k] - n);
    return sum;
  }

  /// √(median of d²/r): how far the lines disagree, whatever a few of them do.
  double spread(const Iterate& at) const {
    std::vector<double> ratios;
    for (int k = 0; k < log_.count; ++k)
      if (at.rows[k] > n) ratios.push_back(at.chi2[k] / (at.rows[k] - n));
    if (ratios.empty()) return 1;
    const auto middle = ratios.begin() + static_cast<long>(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    return std::sqrt(*middle / 0.455);  // the median of χ² with one degree of freedom
  }

  /// Information on u: I + Σ w RᵀR, and the right side Σ w Rᵀy - u.
  void accumulate(const Iterate& at, Eigen::MatrixXd& information, Eigen::VectorXd& right) const {
    int total = 0;
    for (const int rows : at.rows) total += std::max(rows - n, 0);
    RowMatrix stacked(total, p_);
    Eigen::VectorXd y(total);
    int row = 0;
    for (int k = 0; k < log_.count; ++k) {
      const double root = at.rows[k] > n ? std::sqrt(weight(at.chi2[k], at.rows[k] - n)) : 0;
      for (int i = n; i < at.rows[k]; ++i, ++row) {
        stacked.row(row) = root * at.B[k].row(i);
        y[row] = root * at.e[k][i];
      }
    }
    information.setIdentity(p_, p_);
    information.selfadjointView<Eigen::Lower>().rankUpdate(stacked.transpose());
    right = stacked.transpose() * y - at.u;
  }

  void descend(Iterate& now, CalibrationResult& result) {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
    double damping = 0, current = cost(now);
    int last = 0;
    result.outcome = {Status::unreachable, -1};
    while (result.iterations < settings_.iterations) {
      ++result.iterations;
      accumulate(now, information, right);
      Eigen::MatrixXd damped = information;
      damped.diagonal() *= 1 + damping;
      const Eigen::VectorXd step = damped.selfadjointView<Eigen::Lower>().llt().solve(right);
      if (!step.allFinite()) {
        result.outcome = {Status::not_finite, -1};
        return;
      }
      Iterate trial{now.u + step, now.pose};
      double moved_by = 0;
      for (int k = 0; k < log_.count; ++k)
        moved_by = std::max(moved_by, follow(now, k, step, trial));
      const double gain = step.dot(right);  // predicted fall of the cost, and then some
      const bool valid = evaluate(trial, result.status) < 0;
      const double next = valid ? cost(trial) : INFINITY;
      // Steps below 1e-4 σ no longer show in the cost, which rounds; each is a thousand times
      // smaller than the one before, so that two of them end the search.
      const bool small = damping == 0 && valid && gain < 1e-8 && moved_by < 1e-3;
      if (next < current || small) {
        now = std::move(trial);
        current = next;
        damping = damping > 1e-4 ? 0.1 * damping : 0;
        last += small;
        if (gain < 1e-14 || last == 2) {
          result.outcome = {};
          return;
        }
      } else {
        if (damping > 1e10) {
          result.outcome = {Status::singular, -1};
          return;
        }
        damping = std::max(10 * damping, 1e-4);
      }
    }
  }

  /// Pose k after the step of ξ: R δx = e - B δu. @return its largest move in units of its own σ
  double follow(const Iterate& now, int k, const Eigen::VectorXd& step, Iterate& trial) const {
    if (now.rows[k] < n) return 0;
    Joint change{};
    double size = 0;
    for (int i = 0; i < n; ++i) {
      change[i] = now.e[k][i] - now.B[k].row(i).dot(step);
      size = std::max(size, std::fabs(change[i]));
    }
    back_substitute<n>(now.R[k], change);
    trial.pose[k] = moved<K>(now.pose[k], change);
    return size;
  }

  void finish(const Iterate& at, CalibrationResult& result) {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
    accumulate(at, information, right);
    const Eigen::MatrixXd root = information.selfadjointView<Eigen::Lower>().llt().matrixL();
    const Eigen::MatrixXd half = root.triangularView<Eigen::Lower>().solve(
        Eigen::MatrixXd(S_.template triangularView<Eigen::Lower>()).transpose());
    result.covariance = half.transpose() * half;
    result.xi = xi_of(at.u);
    result.pose = at.pose;
    result.chi2 = at.chi2;
    result.cost = cost(at);
    result.weight.assign(log_.count, 0);
    result.redundancy.assign(log_.count, 0);
    result.residual.assign(log_.count * readings_, NAN);
    set_parameters(drawn_, result.xi.data(), robot_);
    for (int k = 0; k < log_.count; ++k) {
      if (at.rows[k] < n) continue;
      result.redundancy[k] = at.rows[k] - n;
      result.weight[k] = at.rows[k] > n ? weight(at.chi2[k], at.rows[k] - n) : 1;
      Extended q_e{}, expected, residual;
      Matrix<kMaxReadings, n> H_x;
      if (!Level::template linearise<K>(robot_, at.pose[k], expected, H_x, nullptr)) continue;
      std::copy_n(line(k), readings_, q_e.begin());
      innovation(robot_, q_e, expected, residual);
      std::copy_n(residual.begin(), readings_, result.residual.begin() + k * readings_);
    }
  }

  const Robot& drawn_;
  const Knowledge& prior_;
  const std::vector<double>& mean_;
  const ReadingLog& log_;
  const CalibrationSettings& settings_;
  Robot robot_;
  const int p_, readings_;
  const RowMatrix S_;
  Loss loss_ = Loss::squares;
  double scale_ = 1;
};

}  // namespace truepose
