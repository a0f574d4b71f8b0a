// Maximum a posteriori estimate of ξ from a robot's own readings.
//
// Minimises |u|² + Σ_k s_k ρ(d_k²) over ξ = μ + S u and every pose x_k, where d_k² is the residual
// of the readings at the best pose k. Poses are eliminated (eliminate.hpp), so that a step solves
// for ξ alone: (I + Σ c RᵀR) δu = Σ c Rᵀy - u with c = s w; each δx_k follows. Measured differences
// between poses add rows (links.hpp).
#pragma once

#include <Eigen/Cholesky>
#include <vector>

#include "truepose/model/geometry.hpp"
#include "truepose/offline/calibration.hpp"

namespace truepose {

/// Batch calibration by Levenberg-Marquardt; deterministic. A robust loss first scales residuals by
/// their median: the initial error is then no outlier, and gross errors never enter as squares.
class Calibrator {
 public:
  Calibrator(const Robot& drawn, const Kernels& model, const Knowledge& prior,
             const std::vector<double>& mean, const ReadingLog& log,
             const CalibrationSettings& settings)
      : drawn_(drawn),
        model_(model),
        prior_(prior),
        mean_(mean),
        log_(log),
        settings_(settings),
        robot_(drawn),
        p_(prior.count),
        n_(model.n),
        readings_(model.n + drawn.r),
        S_(Eigen::Map<const RowMatrix>(prior.root, p_, p_)),
        H_xi_(drawn.finished ? 2 * readings_ * parameter_count(drawn) : 0),
        rest_(log.count),
        loss_(settings.loss, settings.tuning) {}

  CalibrationResult run() {
    CalibrationResult result;
    if (!drawn_.finished) {
      result.outcome = {Status::unfinished, -1};
      return result;
    }
    Iterate now{Eigen::VectorXd::Zero(p_), std::vector<Pose>(log_.count),
                std::vector<Coordinates>(log_.count)};
    believe_in(mean_);
    result.status.assign(log_.count, Status::unreachable);
    reach(now, result.status);
    start_ = place(now, result.status);
    freeze(now, result.status);
    take_out(now, result.status);
    if (counted(result.status) == 0) {
      result.outcome = {Status::unreachable, -1};
      return result;
    }
    search(now, result);
    for (int round = 0; round < kRounds && result.outcome && more(now, result.status); ++round)
      search(now, result);
    finish(now, result);
    return result;
  }

 private:
  /// A geometry, its poses and the linearised readings there.
  struct Iterate {
    Eigen::VectorXd u;
    std::vector<Pose> pose;
    std::vector<Coordinates> pull;  ///< of every pose, due to the links: ν̂
    std::vector<Line> line{};
    std::vector<LinkBlock> block{};
  };

  /// Maximum number of retries of rows that the last geometry excluded.
  static constexpr int kRounds = 10;

  /// Descends from here, over the rows whose status is ok.
  void search(Iterate& now, CalibrationResult& result) {
    last_iteration_ = result.iterations + settings_.iterations;
    if (settings_.loss == Loss::squares) {
      descend(now, result);
    } else {
      scale_ = INFINITY;
      do {  // graduated: from the median's scale down to the stated σ
        scale_ = std::max(1.0, std::min(0.5 * scale_, spread(now)));
        descend(now, result);
      } while (scale_ > 1 && result.outcome);
    }
    if (settings_.nuisances > 0 && result.outcome) {  // once more with D at the new poses
      freeze(now, result.status);
      take_out(now, result.status);
      descend(now, result);
    }
  }

  static long counted(const std::vector<Status>& status) {
    return std::count(status.begin(), status.end(), Status::ok);
  }

  /// Adds excluded rows that have a pose at this geometry. @return whether there are any
  bool more(Iterate& at, std::vector<Status>& status) {
    const long before = counted(status);
    believe(at.u);
    if (!reach(at, status)) return false;
    freeze(at, status);
    take_out(at, status);
    return counted(status) > before;
  }

  /// Evaluates; excludes rows that cannot be evaluated.
  void take_out(Iterate& at, std::vector<Status>& status) {
    for (int bad; (bad = evaluate(at, status)) >= 0;) status[bad] = Status::singular;
  }

  /// D of every row: of influences as given, of nuisances at the current pose. Fixed in the search:
  /// its change with pose and ξ, times η, is of second order in the ideal level's model error.
  void freeze(const Iterate& at, std::vector<Status>& status) {
    const int m = settings_.nuisances, given = settings_.influences;
    if (m + given == 0) return;
    Knowledge axes = prior_;
    axes.count = m;
    axes.column += p_ - m;
    believe_in(xi_of(at.u));
    D_.resize(log_.count);
    for (int k = 0; k < log_.count; ++k)
      if (status[k] == Status::ok)
        status[k] =
            acting(model_, robot_, axes, at.pose[k], influences_of(k), H_xi_.data(), D_[k]).status;
  }

  Influences influences_of(int line) const {
    const int given = settings_.influences;
    return {given, log_.influence + line * readings_ * given};
  }

  std::vector<double> xi_of(const Eigen::VectorXd& u) const {
    std::vector<double> xi = mean_;
    const Eigen::VectorXd change = S_.triangularView<Eigen::Lower>() * u;
    for (int k = 0; k < p_ - settings_.nuisances; ++k)
      if (prior_.column[k] >= 0) xi[prior_.column[k]] += change[k];
    return xi;
  }

  std::vector<double> w_of(const Eigen::VectorXd& u) const {
    std::vector<double> w = log_.links.mean;
    for (int k = 0; k < static_cast<int>(w.size()); ++k) {
      const int at = log_.links.first + k;
      w[k] += S_(at, at) * u[at];
    }
    return w;
  }

  void believe_in(const std::vector<double>& xi) {
    static_cast<void>(set_parameters(drawn_, xi.data(), robot_));  // run() has checked `finished`
  }

  Registration registration_of(const Eigen::VectorXd& u) const {
    const int first = settings_.registration;
    if (first < 0) return start_;
    std::array<double, kRegistration> step;
    for (int k = 0; k < kRegistration; ++k) step[k] = S_(first + k, first + k) * u[first + k];
    return moved(start_, step.data());
  }

  /// Amounts of influences, minus their prior means; the prior may correlate them with ξ.
  Eigen::VectorXd amounts_of(const Eigen::VectorXd& u) const {
    const int given = settings_.influences, first = p_ - settings_.nuisances - given;
    return S_.middleRows(first, given).leftCols(first + given) * u.head(first + given);
  }

  void believe(const Eigen::VectorXd& u) {
    believe_in(xi_of(u));
    registration_ = registration_of(u);
    amount_ = amounts_of(u);
  }

  /// Initial registration, by the first poses.
  Registration place(const Iterate& at, const std::vector<Status>& status) const {
    const int first = settings_.registration;
    if (first < 0 || !log_.measured) return log_.registration;
    // An unknown marker position includes x, an unknown turn the one about the platform's z.
    const int place = first + 6, turn = first + kRegistration - 1;
    return registered(model_.mobility, log_.registration, S_(place, place) > 0, S_(turn, turn) > 0,
                      log_.count - log_.referenced, at.pose.data(), status.data(), log_.measured);
  }

  /// Finds the poses of rows that have none, from the motors at the current geometry.
  /// @return whether there is a new one
  bool reach(Iterate& at, std::vector<Status>& status) {
    const Pose home = to_pose(robot_.mobility, robot_.home);
    Pose guess = home;
    bool more = false;
    for (int k = 0; k < log_.count; ++k) {
      if (status[k] == Status::ok) {
        guess = at.pose[k];
        continue;
      }
      Joint q{};
      std::copy_n(log_.q_e + k * readings_, n_, q.begin());
      for (const Pose& from : {home, guess}) {
        at.pose[k] = from;
        rest_[k] = {};
        status[k] = model_.fkm(robot_, q, at.pose[k], rest_[k]);
        if (status[k] == Status::ok) break;
      }
      guess = status[k] == Status::ok ? at.pose[k] : home;
      more = more || status[k] == Status::ok;
      if (settings_.poll) settings_.poll();
    }
    return more;
  }

  /// Evaluates every good row at this geometry and these poses.
  /// @param last  the iterate that this one was reached from, if any
  /// @return the first row that cannot be evaluated, or -1
  int evaluate(Iterate& at, const std::vector<Status>& status, const Iterate* last = nullptr) {
    believe(at.u);
    at.line.resize(log_.count);
    for (int k = 0; k < log_.count; ++k) {
      at.line[k].rows = 0;
      if (status[k] == Status::ok && !settle(at, k, last)) return k;
      if (settings_.poll) settings_.poll();
    }
    at.block = linked(model_.mobility, log_.links, w_of(at.u).data(), prior_, at.pose, at.line);
    weigh(at);
    return -1;
  }

  void weigh(Iterate& at) const {
    for (LinkBlock& block : at.block) block.weigh(loss_, scale_);
  }

  bool read(Iterate& at, int k) {
    const bool referenced = k >= log_.count - log_.referenced;
    Outside outside;
    if (log_.measured)
      outside = {log_.measured + k * n_, log_.measured_sigma + k * n_,
                 referenced ? &kAligned : &registration_, referenced ? -1 : settings_.registration};
    Line& line = at.line[k];
    line.certain = referenced;
    const int m = settings_.nuisances;
    const Influences given = influences_of(k);
    Extended q_e{};
    std::copy_n(log_.q_e + k * readings_, readings_, q_e.begin());
    for (int c = 0; c < readings_; ++c)
      for (int j = 0; j < given.count; ++j)
        q_e[c] -= given.pattern[c * given.count + j] * amount_[j];
    if (!truepose::read(model_, robot_, prior_, at.pose[k], q_e.data(), outside,
                        m + given.count > 0 ? &D_[k] : nullptr, H_xi_.data(), line, rest_[k]))
      return false;
    for (int i = 0; i < line.rows && m > 0; ++i)
      line.e[i] -= line.B.row(i).tail(m).dot(at.u.tail(m));
    line.pull = at.pull[k];
    return true;
  }

  /// Evaluates row k. A pose more than σ from its row's best (readings grossly wrong, one step
  /// overshoots) takes own steps that never worsen the row; else no damping of ξ lowers the cost.
  bool settle(Iterate& at, int k, const Iterate* last) {
    bool good = read(at, k);
    if (good && at.line[k].away() < 1) return true;
    if (last) {
      const Pose pose = at.pose[k];
      const Line line = at.line[k];
      at.pose[k] = last->pose[k];
      if (const bool kept = read(at, k); good && !(kept && at.line[k].misfit() < line.misfit())) {
        at.pose[k] = pose;
        at.line[k] = line;
      } else {
        good = kept;
      }
    }
    for (int step = 0; good && step < 5 && at.line[k].away() > 1; ++step) {
      const Pose pose = at.pose[k];
      const Line line = at.line[k];
      bool lower = false;
      for (double length = 1; !lower && length > 0.01; length *= 0.25) {
        Coordinates change{};
        for (int i = 0; i < n_; ++i) change[i] = length * (line.e[i] + line.pull[i]);
        back_substitute(n_, line.R, change);
        at.pose[k] = moved(model_.mobility, pose, change);
        lower = read(at, k) && at.line[k].misfit() < line.misfit();
      }
      if (lower) continue;
      at.pose[k] = pose;
      at.line[k] = line;
      break;
    }
    return good;
  }

  double weight(const Line& line) const {
    const int m = line.redundancy();
    if (line.certain) return 1;
    return loss_.scale(m) * loss_.weight(line.d2() / (scale_ * scale_), m);
  }
  double rho(const Line& line) const {
    const double s2 = scale_ * scale_;
    const int m = line.redundancy();
    if (line.certain) return line.d2();
    return s2 * loss_.scale(m) * loss_.rho(line.d2() / s2, m);
  }
  double cost(const Iterate& at) const {
    double sum = at.u.squaredNorm();
    for (const Line& line : at.line)
      if (line.redundancy() > 0) sum += rho(line);
    for (const LinkBlock& block : at.block) sum += block.cost;
    return sum;
  }

  /// √(median of d²/r): robust scale of the rows' residuals.
  double spread(const Iterate& at) const {
    std::vector<double> ratios;
    for (const Line& line : at.line)
      if (line.redundancy() > 0 && !line.certain)
        ratios.push_back(line.misfit() / line.redundancy());
    for (const LinkBlock& block : at.block)
      for (int k = 0; k < block.size(); ++k)
        ratios.push_back(block.y[k] * block.y[k] / (1 + block.shared(k, k)));
    if (ratios.empty()) return 1;
    const auto middle = ratios.begin() + static_cast<long>(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    return std::sqrt(*middle / 0.455);  // the median of χ² with one degree of freedom
  }

  /// Information on u for the step, I + Σ c RᵀR, and the right side, Σ c Rᵀy - u.
  void accumulate(const Iterate& at, Eigen::MatrixXd& information, Eigen::VectorXd& right) const {
    accumulate(at, [&](const Line& line) { return weight(line); }, information, right);
  }
  /// @param counts  c of a row
  template <class F>
  void accumulate(const Iterate& at, F&& counts, Eigen::MatrixXd& information,
                  Eigen::VectorXd& right) const {
    int total = 0;
    for (const Line& line : at.line) total += line.redundancy();
    for (const LinkBlock& block : at.block) total += block.size();
    RowMatrix stacked(total, p_);
    Eigen::VectorXd y(total);
    int row = 0;
    for (const Line& line : at.line) {
      if (line.redundancy() == 0) continue;
      const double root = std::sqrt(counts(line));
      for (int i = n_; i < line.rows; ++i, ++row) {
        stacked.row(row) = root * line.B.row(i);
        y[row] = root * line.e[i];
      }
    }
    for (const LinkBlock& block : at.block) {
      stacked.middleRows(row, block.size()) = block.C.matrixL().solve(block.B);
      y.segment(row, block.size()) = block.C.matrixL().solve(block.y);
      row += block.size();
    }
    information.setIdentity(p_, p_);
    if (total > 0)  // Eigen divides by it
      information.selfadjointView<Eigen::Lower>().rankUpdate(stacked.transpose());
    right = stacked.transpose() * y - at.u;
  }

  void descend(Iterate& now, CalibrationResult& result) {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
    weigh(now);
    double damping = 0, current = cost(now);
    double promised = INFINITY;  // gain of the last undamped step
    int last = 0, freedoms = 1;
    for (const Line& line : now.line) freedoms += line.redundancy();
    for (const LinkBlock& block : now.block) freedoms += block.size();
    result.outcome = {Status::not_converged, -1};
    while (result.iterations < last_iteration_) {
      ++result.iterations;
      accumulate(now, information, right);
      const double scatter = std::max(1.0, current / freedoms);  // 1 for a correct model
      information.diagonal() *= 1 + damping;
      const Eigen::VectorXd step = information.selfadjointView<Eigen::Lower>().llt().solve(right);
      if (!step.allFinite()) {
        result.outcome = {Status::not_finite, -1};
        return;
      }
      Iterate trial{now.u + step, now.pose, std::vector<Coordinates>(log_.count)};
      for (const LinkBlock& block : now.block) pull(log_.links, block, step, trial.pull);
      double moved_by = 0;
      for (int k = 0; k < log_.count; ++k)
        moved_by = std::max(moved_by, std::sqrt(weight(now.line[k])) * follow(now, k, step, trial));
      const double gain = step.dot(right);  // predicted decrease of the cost, at least
      if (damping == 0) promised = gain;
      const bool valid = evaluate(trial, result.status, &now) < 0;
      const double next = valid ? cost(trial) : INFINITY;
      // Steps below 0.01 σ no longer show in the cost, which has rounding errors and poses that lag
      // by one step. Each is at most a hundredth of the previous one: a few of them end the search.
      const bool small = valid && damping < 1 && gain < 1e-4 * scatter && moved_by < 0.1 * scatter;
      if (next < current || small) {
        now = std::move(trial);
        current = next;
        damping = damping > 1e-4 ? 0.1 * damping : 0;
        last += small;
        if (gain < 1e-14 || last == 3) {
          result.outcome = {};
          return;
        }
      } else {
        if (damping > 1e10) {  // no step lowers the cost: at rounding, or singular
          const bool there = promised < 1e-2 * scatter;
          result.outcome = {there ? Status::ok : Status::singular, -1};
          return;
        }
        damping = std::max(10 * damping, 1e-4);
      }
    }
  }

  /// Moves pose k with the step of ξ: R δx = e - B δu + ν̂. @return largest move in units of its σ
  double follow(const Iterate& now, int k, const Eigen::VectorXd& step, Iterate& trial) const {
    const Line& line = now.line[k];
    if (line.rows < n_) return 0;
    Coordinates change{};
    double size = 0;
    for (int i = 0; i < n_; ++i) {
      change[i] = line.e[i] - line.B.row(i).dot(step) + trial.pull[k][i];
      size = std::max(size, std::fabs(change[i]));
    }
    back_substitute(n_, line.R, change);
    trial.pose[k] = moved(model_.mobility, now.pose[k], change);
    return size;
  }

  void finish(Iterate& at, CalibrationResult& result) {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
    const auto worth = [&](const Line& line) {
      if (line.certain) return 1.0;
      return weight(line) < kOutlier ? 0 : loss_.information(line.redundancy());
    };
    result.cost = cost(at);
    result.link.resize(log_.links.link.size());
    for (LinkBlock& block : at.block) {
      Eigen::VectorXd counts(block.size());
      for (int k = 0; k < block.size(); ++k) {
        result.link[block.link[k]].weight = block.weight[k];
        counts[k] = block.weight[k] < kOutlier ? kNothing : loss_.information(1);
      }
      block.weigh(counts);
    }
    accumulate(at, worth, information, right);
    const Eigen::MatrixXd root = information.selfadjointView<Eigen::Lower>().llt().matrixL();
    const Eigen::MatrixXd half =
        root.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd(S_.transpose()));
    const int p = p_ - settings_.nuisances;
    result.covariance = half.leftCols(p).transpose() * half.leftCols(p);
    result.u = at.u;
    result.xi = xi_of(at.u);
    result.start = start_;
    result.registration = registration_of(at.u);
    result.pose = at.pose;
    result.w = w_of(at.u);
    const Eigen::VectorXd amounts = amounts_of(at.u);
    result.amount.assign(amounts.begin(), amounts.end());
    leave_out(at, root, result.link);
    believe_in(result.xi);
    for (const Line& line : at.line) {
      const bool good = line.rows >= n_;
      result.redundancy.push_back(line.redundancy());
      result.chi2.push_back(good ? line.chi2() : NAN);
      result.weight.push_back(line.redundancy() > 0 ? weight(line) : good);
    }
  }

  /// Cross-validates each link against all other data. With V the covariance of all their y,
  /// V⁻¹(y - B û₋) = C⁻¹(y - B û), V⁻¹ = C⁻¹ - C⁻¹B Σ BᵀC⁻¹ =: P (Woodbury), û and Σ of all data.
  /// Entry k over P_kk is the residual of link k without itself, σ² = 1/P_kk.
  /// @param root  of the information on u, Σ⁻¹
  void leave_out(const Iterate& at, const Eigen::MatrixXd& root,
                 std::vector<LinkResult>& result) const {
    for (const LinkBlock& block : at.block) {
      const int m = block.size();
      const Eigen::MatrixXd inverse = block.C.solve(Eigen::MatrixXd::Identity(m, m));
      const Eigen::MatrixXd half =
          root.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd(block.B.transpose() * inverse));
      const Eigen::VectorXd z = inverse * block.y;
      for (int k = 0; k < m; ++k) {
        LinkResult& of = result[block.link[k]];
        const double sigma = log_.links.link[block.link[k]].sigma;
        const double P = inverse(k, k) - half.col(k).squaredNorm();
        of.residual = sigma * block.e[k];
        of.left_out = sigma * z[k] / P;
        of.sigma = sigma * std::sqrt(std::max(1 / P - 1 / block.weight[k], 0.0) + 1);
      }
    }
  }

  const Robot& drawn_;
  const Kernels& model_;
  const Knowledge& prior_;
  const std::vector<double>& mean_;
  const ReadingLog& log_;
  const CalibrationSettings& settings_;
  Robot robot_;
  const int p_, n_, readings_;
  const RowMatrix S_;
  std::vector<double> H_xi_;
  std::vector<Parasitic> rest_;  ///< start of each row's solution (full level)
  std::vector<RowMatrix> D_;     ///< of each row's influences and nuisances
  Registration start_, registration_;
  Eigen::VectorXd amount_;  ///< of influences, minus their prior means
  const LineLoss loss_;
  double scale_ = 1;
  int last_iteration_ = 0;
};

}  // namespace truepose
