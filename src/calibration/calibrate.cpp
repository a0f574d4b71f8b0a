// Maximum a posteriori estimate of ξ from a robot's own readings.
#include "calibration/calibrate.hpp"

#include "calibration/iterate.hpp"
#include "mechanism/geometry.hpp"

namespace truepose {
namespace {
/// The search for ξ, with what it has found so far.
struct Calibrator {
  const Level level_;
  const Robot& drawn_;
  const Knowledge& prior_;
  const std::vector<double>& mean_;
  const ReadingLog& log_;
  const CalibrationSettings& settings_;

  const int p_ = prior_.count, n_ = dof(drawn_.mobility), readings_ = readings(drawn_);
  const RowMatrix S_{p_, p_, prior_.root};
  Robot robot_ = drawn_;
  std::vector<double> H_xi_{};
  /// Start of each row's solution (full level).
  std::vector<Parasitic> rest_ = std::vector<Parasitic>(log_.count);
  /// Of each row's influences and nuisances.
  std::vector<RowMatrix> D_ = std::vector<RowMatrix>(log_.count);
  RowLoss loss_{};
  Outliers out_ = none();
  int last_iteration_ = 0;
  CalibrationResult result_{};

  CalibrationResult run() {
    result_.status.assign(log_.count, Status::unreachable);
    result_.outcome = {drawn_.finished ? Status::unreachable : Status::unfinished};
    if (!drawn_.finished) return result_;
    H_xi_.resize(2 * readings_ * parameter_count(drawn_));
    Iterate now{std::vector<double>(p_), std::vector<Pose>(log_.count), no_pull()};
    believe(now.u);
    reach(now);
    result_.start = result_.registration = initial_registration(now);
    include(now);
    if (counted() == 0) return result_;
    search(now);
    for (int round = 0; round < kRounds && result_.outcome && more(now); ++round) search(now);
    finish(now);
    return result_;
  }

  using Iterate = CalibrationIterate;

  /// Maximum number of retries of rows that the last geometry excluded.
  static constexpr int kRounds = 10;
  /// Most steps by squares of all rows, and at each scale of Student's loss; most scales; most
  /// decisions about outliers.
  static constexpr int kFirst = 30, kRough = 20, kScales = 20, kDecisions = 10;
  /// Largest scale of noise, over that stated, that least squares of all rows may have: beyond it
  /// gross errors may be many.
  static constexpr double kNoisy = 2;

  std::vector<Coordinates> no_pull() const { return std::vector<Coordinates>(log_.count); }
  Outliers none() const {
    return {std::vector<char>(log_.count), std::vector<char>(log_.links.link.size())};
  }

  long counted() const {
    return std::count(result_.status.begin(), result_.status.end(), Status::ok);
  }

  /// Descends from here, over the rows whose status is ok.
  void search(Iterate& now) {
    const Iterate start{now.u, now.pose, no_pull()};
    const std::vector<Status> status = result_.status;
    out_ = none();
    now.weigh(loss_, out_);
    const bool squares = settings_.loss == Loss::squares;
    converge(now, squares ? settings_.iterations : kFirst);
    if (squares) return;
    if (result_.outcome && now.outliers(log_.links, scale(now, kNoisy)) == none()) return;
    const auto restart = [&] {
      now = start;
      rest_.assign(log_.count, {});
      result_.status = status;
      include(now);
    };
    restart();
    out_ = rough(now);
    restart();  // converges as the log without its outliers does
    for (int k = 0; k < kDecisions; ++k) {
      converge(now, settings_.iterations);
      if (!result_.outcome) return;
      const Outliers next = now.outliers(log_.links, scale(now));
      if (next == out_ || k == kDecisions - 1) return;
      out_ = next;
      include(now);
    }
  }

  /// Scale of the noise: at least that stated.
  static double scale(const Iterate& at, double most = INFINITY) {
    return std::clamp(at.spread(), 1.0, most);
  }

  /// Descends by Student's loss at a scale that decreases to that of the median. _return outliers
  Outliers rough(Iterate& now) {
    for (int k = 0; k < kScales; ++k) {
      loss_.unit = scale(now);
      last_iteration_ = result_.iterations + std::min(kRough, settings_.iterations);
      now.weigh(loss_, out_);
      if (descend(now).status == Status::not_finite || scale(now) > 0.7 * loss_.unit) break;
    }
    Outliers result = out_;
    for (int k = 0; k < log_.count; ++k)
      result.line[k] = now.line[k].redundancy() > 0 && now.line[k].weight(loss_) < kOutlier;
    for (const LinkBlock& block : now.block)
      for (int k = 0; k < block.size(); ++k)
        result.link[block.link[k]] = block.weight[k] < kOutlier;
    loss_ = {};
    return result;
  }

  /// Descends by squares, in at most so many steps.
  void converge(Iterate& now, int most) {
    last_iteration_ = result_.iterations + std::min(most, settings_.iterations);
    result_.outcome = descend(now);
    if (settings_.nuisances > 0 && result_.outcome) {  // once more with D at the new poses
      include(now);
      last_iteration_ = result_.iterations + std::min(most, settings_.iterations);
      result_.outcome = descend(now);
    }
  }

  /// Adds excluded rows that have a pose at this geometry. _return whether there are any
  bool more(Iterate& at) {
    const long before = counted();
    believe(at.u);
    // A geometry far off may have home on the other side of a singular pose.
    static_cast<void>(note_assembly(robot_));
    if (!reach(at)) return false;
    include(at);
    return counted() > before;
  }

  /// Evaluates the rows with a pose; excludes those that cannot be evaluated.
  void include(Iterate& at) {
    freeze(at);
    for (int bad; (bad = evaluate(at)) >= 0;) result_.status[bad] = Status::singular;
  }

  /// D of every row: of influences as given, of nuisances at the current pose. Fixed in the search:
  /// its change with pose and ξ, times η, is of second order in the ideal level's model error.
  void freeze(const Iterate& at) {
    Knowledge axes = prior_;
    axes.count = settings_.nuisances;
    axes.column += p_ - axes.count;
    believe(at.u);
    for (int k = 0; k < log_.count; ++k)
      if (result_.status[k] == Status::ok)
        result_.status[k] =
            acting(robot_, axes, at.pose[k], influences_of(k), H_xi_.data(), D_[k]).status;
  }

  Influences influences_of(int line) const {
    const int given = settings_.influences;
    return {given, log_.influence + line * readings_ * given};
  }

  /// Sets robot, registration, links' unknowns and influences' amounts to those of u.
  void believe(const std::vector<double>& u) {
    const int parameters = p_ - settings_.nuisances, given = settings_.influences;
    const std::vector<double> change = S_ * u;
    result_.xi = mean_;
    for (int k = 0; k < parameters; ++k)
      if (prior_.column[k] >= 0) result_.xi[prior_.column[k]] += change[k];
    static_cast<void>(set_parameters(drawn_, result_.xi.data(), robot_));  // `finished`: see run()
    result_.w = log_.links.mean;
    for (std::size_t k = 0; k < result_.w.size(); ++k) result_.w[k] += change[log_.links.first + k];
    if (const int first = settings_.registration; first >= 0)
      result_.registration = moved(result_.start, change.data() + first);
    const auto amounts = change.begin() + parameters;  // less their prior means
    result_.amount.assign(amounts - given, amounts);
  }

  /// Initial registration, by the first poses.
  Registration initial_registration(const Iterate& at) const {
    const int first = settings_.registration;
    if (first < 0 || !log_.measured) return log_.registration;
    // An unknown marker position includes x, an unknown turn the one about the platform's z.
    const int place = first + 6, turn = first + kRegistration - 1;
    return registered(robot_.mobility, log_.registration, S_(first, first) > 0,
                      S_(place, place) > 0, S_(turn, turn) > 0, log_.count - log_.referenced,
                      at.pose.data(), result_.status.data(), log_.measured);
  }

  /// Finds poses of rows without one, from the motors. _return whether there is a new one
  bool reach(Iterate& at) {
    const Pose home = to_pose(robot_.mobility, robot_.home);
    Pose guess = home;
    bool more = false;
    for (int k = 0; k < log_.count; ++k) {
      Status& status = result_.status[k];
      if (status != Status::ok) {
        Joint q{};
        std::copy_n(log_.q_e + k * readings_, drawn_.motors, q.begin());
        for (const Pose& from : {home, guess}) {
          at.pose[k] = from;
          rest_[k] = {};
          status = motors_pose(level_, robot_, q, at.pose[k], rest_[k]);
          if (status == Status::ok) break;
        }
        more = more || status == Status::ok;
        if (settings_.poll) settings_.poll();
      }
      guess = status == Status::ok ? at.pose[k] : home;
    }
    return more;
  }

  /// Evaluates every good row at this geometry and these poses.
  /// _param last  the iterate that this one was reached from, if any
  /// _return the first row that cannot be evaluated, or -1
  int evaluate(Iterate& at, const Iterate* last = nullptr) {
    believe(at.u);
    at.line.resize(log_.count);
    for (int k = 0; k < log_.count; ++k) {
      at.line[k].rows = 0;
      if (result_.status[k] == Status::ok && !settle(at, k, last)) return k;
      if (settings_.poll) settings_.poll();
    }
    at.block = linked(robot_.mobility, log_.links, result_.w.data(), prior_, at.pose, at.line);
    at.weigh(loss_, out_);
    return -1;
  }

  bool linearise_row(Iterate& at, int k) {
    Line& line = at.line[k];
    if (!linearise_row(at, k, prior_, D_[k], line)) return false;
    const int m = settings_.nuisances;
    for (int i = 0; i < line.rows; ++i)
      line.e[i] -= dot(m, line.B[i] + p_ - m, at.u.data() + p_ - m);
    line.pull = at.pull[k];
    return true;
  }

  /// _param known, D  as of linearise_line: with more columns than the prior's, or its own
  bool linearise_row(const Iterate& at, int k, const Knowledge& known, const RowMatrix& D,
                     Line& line) {
    const bool referenced = k >= log_.count - log_.referenced;
    Outside outside;
    if (log_.measured)
      outside = {log_.measured + k * n_, log_.measured_sigma + k * n_,
                 referenced ? &kAligned : &result_.registration,
                 referenced ? -1 : settings_.registration};
    line.certain = referenced, line.outlier = out_.line[k];
    const Influences given = influences_of(k);
    Extended q_e{};
    std::copy_n(log_.q_e + k * readings_, readings_, q_e.begin());
    for (int c = 0; c < readings_; ++c)
      for (int j = 0; j < given.count; ++j)
        q_e[c] -= given.pattern[c * given.count + j] * result_.amount[j];
    return linearise_line(level_, robot_, known, at.pose[k], q_e.data(), outside, D, H_xi_.data(),
                          line, rest_[k])
               .status == Status::ok;
  }

  /// Moves row k to a pose of lower misfit, or to any if it has `none`. _return whether it moved
  bool lower(Iterate& at, int k, const Pose& to, bool none = false) {
    const Pose pose = at.pose[k];
    const Line line = at.line[k];
    at.pose[k] = to;
    if (linearise_row(at, k) && (none || at.line[k].misfit() < line.misfit())) return true;
    at.pose[k] = pose;
    at.line[k] = line;
    return false;
  }

  /// Evaluates row k. A pose more than σ from its row's best (readings grossly wrong, one step
  /// overshoots) takes own steps that never worsen the row; else no damping of ξ lowers the cost.
  bool settle(Iterate& at, int k, const Iterate* last) {
    bool good = linearise_row(at, k);
    const Line& line = at.line[k];
    if (good && line.away() < 1) return true;
    if (last) good = lower(at, k, last->pose[k], !good) || good;
    for (int step = 0; good && step < 5 && line.away() > 1; ++step) {
      const Pose pose = at.pose[k];
      Coordinates change{};
      for (int i = 0; i < n_; ++i) change[i] = line.e[i] + line.pull[i];
      back_substitute(n_, line.R, change);
      bool moves = false;
      for (double length = 1; !moves && length > 0.01; length *= 0.25) {
        moves = lower(at, k, moved(robot_.mobility, pose, change));
        for (double& part : change) part *= 0.25;
      }
      if (!moves) break;
    }
    return good;
  }

  Outcome descend(Iterate& now) {
    double damping = 0, current = now.cost(loss_);
    double promised = INFINITY;  // gain of the last undamped step
    int last = 0;
    const int freedoms = 1 + now.equations();
    while (result_.iterations < last_iteration_) {
      ++result_.iterations;
      auto [information, right] = now.step(loss_);
      const double scatter = std::max(1.0, current / freedoms);  // 1 for a correct model
      for (int k = 0; k < p_; ++k) information(k, k) *= 1 + damping;
      const std::vector<double> step = solve_cholesky(cholesky(information), right);
      if (!all_finite(step, p_)) return {Status::not_finite, -1};
      Iterate trial{now.u, now.pose, no_pull()};
      for (int k = 0; k < p_; ++k) trial.u[k] += step[k];
      for (const LinkBlock& block : now.block) pull(block, step, trial.pull);
      double moved_by = 0;
      for (int k = 0; k < log_.count; ++k)
        moved_by =
            std::max(moved_by, std::sqrt(now.line[k].weight(loss_)) * follow(now, k, step, trial));
      const double gain =
          dot(p_, step.data(), right.data());  // predicted decrease of the cost, at least
      if (damping == 0) promised = gain;
      const bool valid = evaluate(trial, &now) < 0;
      const double next = valid ? trial.cost(loss_) : INFINITY;
      // Steps below 0.01 σ no longer show in the cost, which has rounding errors and poses that lag
      // by one step. Each is at most a hundredth of the previous one: a few of them end the search.
      const bool small = valid && damping < 1 && gain < 1e-4 * scatter && moved_by < 0.1 * scatter;
      if (next < current || small) {
        now = std::move(trial);
        current = next;
        damping = damping > 1e-4 ? 0.1 * damping : 0;
        last += small;
        if (gain < 1e-14 || last == 3) return {};
      } else if (damping > 1e10) {  // no step lowers the cost: at rounding, or singular
        return {promised < 1e-2 * scatter ? Status::ok : Status::singular, -1};
      } else {
        damping = std::max(10 * damping, 1e-4);
      }
    }
    return {Status::not_converged, -1};
  }

  /// Moves pose k with the step of ξ: R δx = e - B δu + ν̂. _return largest move in units of its σ
  double follow(const Iterate& now, int k, const std::vector<double>& step, Iterate& trial) const {
    const Line& line = now.line[k];
    if (line.rows < n_) return 0;
    Coordinates change{};
    double size = 0;
    for (int i = 0; i < n_; ++i) {
      change[i] = line.e[i] - dot(p_, line.B[i], step.data()) + trial.pull[k][i];
      size = std::max(size, std::fabs(change[i]));
    }
    back_substitute(n_, line.R, change);
    trial.pose[k] = moved(robot_.mobility, now.pose[k], change);
    return size;
  }

  /// The equations of the last step, with a column for an error of each reading.
  void tabulate(const Iterate& at) {
    const int width = p_ + readings_;
    std::vector<std::int32_t> column(prior_.column, prior_.column + p_);
    column.resize(width, -1);
    RowMatrix root = RowMatrix::identity(width);
    for (int i : range(p_)) std::copy_n(S_[i], p_, root[i]);
    const Knowledge wide{width, column.data(), root.data(), prior_.sigma};
    std::vector<Line> lines(log_.count);
    for (int k = 0; k < log_.count; ++k) {
      if (at.line[k].rows < n_) continue;
      RowMatrix D(readings_, D_[k].cols() + readings_);
      for (int c = 0; c < readings_; ++c) {
        std::copy_n(D_[k][c], D_[k].cols(), D[c]);
        D(c, D_[k].cols() + c) = 1;
      }
      if (linearise_row(at, k, wide, D, lines[k])) lines[k].e = at.line[k].e;
    }
    const std::vector<LinkBlock> blocks =
        linked(robot_.mobility, log_.links, result_.w.data(), wide, at.pose, lines);
    LogRows& all = result_.rows;
    const int rows = equation_count(lines, blocks);
    all.B = RowMatrix(rows, p_), all.D = RowMatrix(rows, readings_);
    each_equation(lines, blocks, [&](const double* from, double y, int line, bool linked) {
      const int row = static_cast<int>(all.y.size());
      std::copy_n(from, p_, all.B[row]);
      std::copy_n(from + p_, readings_, all.D[row]);
      all.y.push_back(y);
      all.line.push_back(linked ? -1 : line);
    });
    const std::vector<double> moved = all.B * at.u;
    for (int i = 0; i < rows; ++i) all.y[i] += moved[i];
  }

  void finish(Iterate& at) {
    believe(at.u);
    if (settings_.rows) tabulate(at);
    result_.cost = at.cost(loss_);
    result_.u = at.u;
    result_.pose = at.pose;
    result_.link.resize(log_.links.link.size());
    for (const LinkBlock& block : at.block)
      for (int k = 0; k < block.size(); ++k) result_.link[block.link[k]].weight = block.weight[k];
    const RowMatrix root = cholesky(at.step(loss_).information);
    const int parameters = p_ - settings_.nuisances;
    RowMatrix half(p_, parameters);
    for (int i = 0; i < p_; ++i)
      for (int k = 0; k < parameters; ++k) half(i, k) = S_(k, i);
    solve_lower(root, half);
    result_.covariance = plus_gram(RowMatrix(parameters, parameters), half);
    for (const LinkBlock& block : at.block) cross_validate(log_.links, block, root, result_.link);
    for (const Line& line : at.line) {
      const bool good = line.rows >= n_;
      result_.redundancy.push_back(line.redundancy());
      result_.chi2.push_back(good ? line.chi2() : NAN);
      result_.weight.push_back(line.redundancy() > 0 ? line.weight(loss_) : good);
    }
  }
};
}  // namespace

CalibrationResult calibrate(Level level, const Robot& drawn, const Knowledge& prior,
                            const std::vector<double>& mean, const ReadingLog& log,
                            const CalibrationSettings& settings) {
  return Calibrator{level, drawn, prior, mean, log, settings}.run();
}
}  // namespace truepose
