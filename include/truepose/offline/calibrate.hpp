// Which geometry explains a robot's own readings? The maximum a posteriori estimate of ξ.
//
// Minimises |u|² + Σ_k s_k ρ(d_k²) over ξ = μ + S u and every pose x_k, where d_k² is what the
// readings at pose k still disagree about once the best pose is taken. Poses are eliminated
// (eliminate.hpp), so that a step solves for ξ alone: (I + Σ c RᵀR) δu = Σ c Rᵀy - u with c = s w,
// then each δx_k follows.
#pragma once

#include <Eigen/Cholesky>
#include <functional>
#include <vector>

#include "truepose/model/geometry.hpp"
#include "truepose/offline/line.hpp"
#include "truepose/offline/loss.hpp"

namespace truepose {

/// How a batch calibration is done.
struct CalibrationSettings {
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
  const double* measured = nullptr;        ///< count × n coordinates, or nullptr
  const double* measured_sigma = nullptr;  ///< of those, > 0
  Registration registration{};  ///< of those; the marker to begin with where it is unknown
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
  std::vector<Pose> pose;       ///< x̂ of every line of the log
  std::vector<Status> status;   ///< of every line; one that is not ok was left out
  std::vector<double> chi2;     ///< d² of every line
  std::vector<int> redundancy;  ///< equations that a line leaves over for ξ
  std::vector<double> weight;   ///< of every line: 1, or less where it is an outlier
  double cost = 0;
};

/// Batch calibration. Levenberg-Marquardt; the same on every run.
/// Under a robust loss residuals first count in units of their median, so that the geometry's own
/// error does not look like one big outlier, and the squares never see a gross one.
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
    Iterate now{Eigen::VectorXd::Zero(p_), std::vector<Pose>(log_.count)};
    result.status = start(now);
    start_ = place(now, result.status);
    freeze(now, result.status);
    for (int bad; (bad = evaluate(now, result.status)) >= 0;) result.status[bad] = Status::singular;
    if (std::count(result.status.begin(), result.status.end(), Status::ok) == 0) {
      result.outcome = {Status::unreachable, -1};
      return result;
    }
    if (settings_.loss == Loss::squares) {
      descend(now, result);
    } else {
      scale_ = INFINITY;
      do {  // graduated: from what the median calls normal, down to the stated σ
        scale_ = std::max(1.0, std::min(0.5 * scale_, spread(now)));
        descend(now, result);
      } while (scale_ > 1 && result.outcome);
    }
    if (settings_.nuisances > 0 && result.outcome) {  // once more with D where the poses now are
      freeze(now, result.status);
      for (int bad; (bad = evaluate(now, result.status)) >= 0;)
        result.status[bad] = Status::singular;
      descend(now, result);
    }
    finish(now, result);
    return result;
  }

 private:
  /// A geometry and its poses; what the readings say there.
  struct Iterate {
    Eigen::VectorXd u;
    std::vector<Pose> pose;
    std::vector<Line> line{};
  };

  /// D of every line, where its pose is now. It is held while the search goes on: its change with
  /// pose and ξ, times η, is of the second order of what the ideal level leaves out.
  void freeze(const Iterate& at, std::vector<Status>& status) {
    const int m = settings_.nuisances;
    if (m == 0) return;
    Knowledge axes = prior_;
    axes.count = m;
    axes.column += p_ - m;
    believe_in(xi_of(at.u));
    D_.resize(log_.count);
    for (int k = 0; k < log_.count; ++k)
      if (status[k] == Status::ok)
        status[k] = model_.left_out(robot_, axes, at.pose[k], H_xi_.data(), D_[k]).status;
  }

  std::vector<double> xi_of(const Eigen::VectorXd& u) const {
    std::vector<double> xi = mean_;
    const Eigen::VectorXd change = S_.triangularView<Eigen::Lower>() * u;
    for (int k = 0; k < p_ - settings_.nuisances; ++k)
      if (!of_registration(k)) xi[prior_.column[k]] += change[k];
    return xi;
  }

  void believe_in(const std::vector<double>& xi) {
    static_cast<void>(set_parameters(drawn_, xi.data(), robot_));  // finished: run() has asked
  }

  bool of_registration(int k) const {
    const int first = settings_.registration;
    return first >= 0 && k >= first && k < first + kRegistration;
  }

  Registration registration_of(const Eigen::VectorXd& u) const {
    const int first = settings_.registration;
    if (first < 0) return start_;
    std::array<double, kRegistration> step;
    for (int k = 0; k < kRegistration; ++k) step[k] = S_(first + k, first + k) * u[first + k];
    return moved(start_, step.data());
  }

  void believe(const Eigen::VectorXd& u) {
    believe_in(xi_of(u));
    registration_ = registration_of(u);
  }

  /// First registration: by the first poses.
  Registration place(const Iterate& at, const std::vector<Status>& status) const {
    const int first = settings_.registration;
    if (first < 0 || !log_.measured) return log_.registration;
    // Every unknown place of a marker has an x, every unknown turn one about the nacelle's z.
    const int place = first + 6, turn = first + kRegistration - 1;
    return registered(model_.mobility, log_.registration, S_(place, place) > 0, S_(turn, turn) > 0,
                      log_.count, at.pose.data(), status.data(), log_.measured);
  }

  /// First poses: from the motors, at the prior mean.
  std::vector<Status> start(Iterate& at) {
    believe_in(mean_);
    std::vector<Status> status(log_.count, Status::ok);
    const Pose home = to_pose(robot_.mobility, robot_.home);
    Pose guess = home;
    for (int k = 0; k < log_.count; ++k) {
      Joint q{};
      std::copy_n(log_.q_e + k * readings_, n_, q.begin());
      for (const Pose& from : {home, guess}) {
        at.pose[k] = from;
        rest_[k] = {};
        status[k] = model_.fkm(robot_, q, at.pose[k], rest_[k]);
        if (status[k] == Status::ok) break;
      }
      guess = status[k] == Status::ok ? at.pose[k] : home;
      if (settings_.poll) settings_.poll();
    }
    return status;
  }

  /// Reads every good line at this geometry and these poses.
  /// @param last  the iterate that this one was reached from, if any
  /// @return the first line that cannot be read, or -1
  int evaluate(Iterate& at, const std::vector<Status>& status, const Iterate* last = nullptr) {
    believe(at.u);
    at.line.resize(log_.count);
    for (int k = 0; k < log_.count; ++k) {
      at.line[k].rows = 0;
      if (status[k] == Status::ok && !settle(at, k, last)) return k;
      if (settings_.poll) settings_.poll();
    }
    return -1;
  }

  bool read(Iterate& at, int k) {
    Outside outside;
    if (log_.measured)
      outside = {log_.measured + k * n_, log_.measured_sigma + k * n_, &registration_,
                 settings_.registration};
    Line& line = at.line[k];
    const int m = settings_.nuisances;
    if (!truepose::read(model_, robot_, prior_, at.pose[k], log_.q_e + k * readings_, outside,
                        m > 0 ? &D_[k] : nullptr, H_xi_.data(), line, rest_[k]))
      return false;
    for (int i = 0; i < line.rows && m > 0; ++i)
      line.e[i] -= line.B.row(i).tail(m).dot(at.u.tail(m));
    return true;
  }

  /// Reads line k. A pose more than σ from its line's best, where readings are grossly wrong and
  /// one step overshoots, takes steps of its own that never worsen the line: without them no
  /// damping of ξ would ever lower the cost.
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
        for (int i = 0; i < n_; ++i) change[i] = length * line.e[i];
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
    return loss_.scale(m) * loss_.weight(line.d2() / (scale_ * scale_), m);
  }
  double rho(const Line& line) const {
    const double s2 = scale_ * scale_;
    const int m = line.redundancy();
    return s2 * loss_.scale(m) * loss_.rho(line.d2() / s2, m);
  }
  double cost(const Iterate& at) const {
    double sum = at.u.squaredNorm();
    for (const Line& line : at.line)
      if (line.redundancy() > 0) sum += rho(line);
    return sum;
  }

  /// √(median of d²/r): how far the lines disagree, whatever a few of them do.
  double spread(const Iterate& at) const {
    std::vector<double> ratios;
    for (const Line& line : at.line)
      if (line.redundancy() > 0) ratios.push_back(line.misfit() / line.redundancy());
    if (ratios.empty()) return 1;
    const auto middle = ratios.begin() + static_cast<long>(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    return std::sqrt(*middle / 0.455);  // the median of χ² with one degree of freedom
  }

  /// Information on u as the step takes it, and the right side: I + Σ c RᵀR and Σ c Rᵀy - u.
  void accumulate(const Iterate& at, Eigen::MatrixXd& information, Eigen::VectorXd& right) const {
    accumulate(at, [&](const Line& line) { return weight(line); }, information, right);
  }
  /// @param counts  c of a line
  template <class F>
  void accumulate(const Iterate& at, F&& counts, Eigen::MatrixXd& information,
                  Eigen::VectorXd& right) const {
    int total = 0;
    for (const Line& line : at.line) total += line.redundancy();
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
    information.setIdentity(p_, p_);
    if (total > 0)  // Eigen divides by it
      information.selfadjointView<Eigen::Lower>().rankUpdate(stacked.transpose());
    right = stacked.transpose() * y - at.u;
  }

  void descend(Iterate& now, CalibrationResult& result) {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
    double damping = 0, current = cost(now);
    double promised = INFINITY;  // by the last step without damping
    int last = 0, freedoms = 1;
    for (const Line& line : now.line) freedoms += line.redundancy();
    result.outcome = {Status::not_converged, -1};
    while (result.iterations < settings_.iterations) {
      ++result.iterations;
      accumulate(now, information, right);
      const double scatter = std::max(1.0, current / freedoms);  // 1 where the model is right
      information.diagonal() *= 1 + damping;
      const Eigen::VectorXd step = information.selfadjointView<Eigen::Lower>().llt().solve(right);
      if (!step.allFinite()) {
        result.outcome = {Status::not_finite, -1};
        return;
      }
      Iterate trial{now.u + step, now.pose};
      double moved_by = 0;
      for (int k = 0; k < log_.count; ++k)
        moved_by = std::max(moved_by, std::sqrt(weight(now.line[k])) * follow(now, k, step, trial));
      const double gain = step.dot(right);  // predicted fall of the cost, and then some
      if (damping == 0) promised = gain;
      const bool valid = evaluate(trial, result.status, &now) < 0;
      const double next = valid ? cost(trial) : INFINITY;
      // Steps below 0.01 σ no longer show in the cost, which rounds and whose poses lag by one
      // step. Each is at most a hundredth of the one before: a few of them end the search.
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
        if (damping > 1e10) {  // no step lowers the cost: at rounding, or nowhere
          const bool there = promised < 1e-2 * scatter;
          result.outcome = {there ? Status::ok : Status::singular, -1};
          return;
        }
        damping = std::max(10 * damping, 1e-4);
      }
    }
  }

  /// Pose k after the step of ξ: R δx = e - B δu. @return its largest move in units of its own σ
  double follow(const Iterate& now, int k, const Eigen::VectorXd& step, Iterate& trial) const {
    const Line& line = now.line[k];
    if (line.rows < n_) return 0;
    Coordinates change{};
    double size = 0;
    for (int i = 0; i < n_; ++i) {
      change[i] = line.e[i] - line.B.row(i).dot(step);
      size = std::max(size, std::fabs(change[i]));
    }
    back_substitute(n_, line.R, change);
    trial.pose[k] = moved(model_.mobility, now.pose[k], change);
    return size;
  }

  void finish(const Iterate& at, CalibrationResult& result) {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
    const auto worth = [&](const Line& line) {
      return weight(line) < kOutlier ? 0 : loss_.information(line.redundancy());
    };
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
    result.cost = cost(at);
    believe_in(result.xi);
    for (const Line& line : at.line) {
      const bool good = line.rows >= n_;
      result.redundancy.push_back(line.redundancy());
      result.chi2.push_back(good ? line.chi2() : NAN);
      result.weight.push_back(line.redundancy() > 0 ? weight(line) : good);
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
  std::vector<Parasitic> rest_;  ///< where each line's solution starts (full level)
  std::vector<RowMatrix> D_;     ///< of each line's nuisances
  Registration start_, registration_;
  const LineLoss loss_;
  double scale_ = 1;
};

}  // namespace truepose
