// Maximum a posteriori estimate of ξ from a robot's own readings.
#include "calibration/calibrate.hpp"

#include "calibration/iterate.hpp"
#include "mechanism/geometry.hpp"

namespace truepose {
namespace {
/// The search for ξ, with what it has found so far.
struct Calibrator {
  const Level level;
  const Robot& drawn;
  const Knowledge& prior;
  const std::vector<double>& mean;
  const ReadingLog& log;
  const CalibrationSettings& settings;

  const int p = prior.count, n = dof(drawn.mobility), readings = truepose::readings(drawn);
  const RowMatrix S{p, p, prior.root};
  Robot robot = drawn;
  std::vector<double> H_xi{};
  /// Start of each row's solution (full level).
  std::vector<Parasitic> rest = std::vector<Parasitic>(log.count);
  /// Of each row's influences and nuisances.
  std::vector<RowMatrix> D = std::vector<RowMatrix>(log.count);
  std::vector<double> amount{};  ///< of these
  RowLoss loss{};
  Outliers out = none();
  int last_iteration = 0;
  CalibrationResult result{};

  CalibrationResult run() {
    result.status.assign(log.count, Status::unreachable);
    result.outcome = {drawn.finished ? Status::unreachable : Status::unfinished};
    if (!drawn.finished) return result;
    H_xi.resize(2 * readings * parameter_count(drawn));
    Iterate now{std::vector<double>(p), std::vector<Pose>(log.count)};
    believe(now.u);
    reach(now);
    result.start = result.registration = initial_registration(now);
    include(now);
    if (counted() == 0) return result;
    search(now);
    for (int round = 0; round < kRounds && result.outcome && more(now); ++round) search(now);
    finish(now);
    return result;
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

  Outliers none() const {
    return {std::vector<char>(log.count), std::vector<char>(log.links.link.size())};
  }

  long counted() const {
    return std::count(result.status.begin(), result.status.end(), Status::ok);
  }

  /// Descends from here, over the rows whose status is ok.
  void search(Iterate& now) {
    const Iterate start{now.u, now.pose};
    const std::vector<Status> status = result.status;
    out = none();
    now.weigh(loss, out);
    const bool squares = settings.loss == Loss::squares;
    converge(now, squares ? settings.iterations : kFirst);
    if (squares) return;
    if (result.outcome && now.outliers(log.links, scale(now, kNoisy)) == none()) return;
    const auto restart = [&] {
      now = start;
      rest.assign(log.count, {});
      result.status = status;
      include(now);
    };
    restart();
    out = rough(now);
    restart();  // converges as the log without its outliers does
    for (int k : range(kDecisions)) {
      converge(now, settings.iterations);
      if (!result.outcome) return;
      const Outliers next = now.outliers(log.links, scale(now));
      if (next == out || k == kDecisions - 1) return;
      out = next;
      include(now);
    }
  }

  /// Scale of the noise: at least that stated.
  static double scale(const Iterate& at, double most = INFINITY) {
    return clamp(at.spread(), 1.0, most);
  }

  /// Descends by Student's loss at a scale that decreases to that of the median. @return outliers
  Outliers rough(Iterate& now) {
    for (int k = 0; k < kScales; ++k) {
      loss.unit = scale(now);
      last_iteration = result.iterations + min(kRough, settings.iterations);
      now.weigh(loss, out);
      if (descend(now).status == Status::not_finite || scale(now) > 0.7 * loss.unit) break;
    }
    Outliers found = out;
    for (int k : range(log.count))
      found.line[k] = now.line[k].redundancy() > 0 && now.line[k].weight(loss) < kOutlier;
    for (const LinkBlock& block : now.block)
      for (int k : range(block.size())) found.link[block.link[k]] = block.weight[k] < kOutlier;
    loss = {};
    return found;
  }

  /// Descends by squares, in at most so many steps; with nuisances once more with D at the new
  /// poses.
  void converge(Iterate& now, int most) {
    for (int pass : range(settings.nuisances > 0 ? 2 : 1)) {
      if (pass > 0) include(now);
      last_iteration = result.iterations + min(most, settings.iterations);
      result.outcome = descend(now);
      if (!result.outcome) return;
    }
  }

  /// Adds excluded rows that have a pose at this geometry. @return whether there are any
  bool more(Iterate& at) {
    const long before = counted();
    believe(at.u);
    // A geometry far off may have home on the other side of a singular pose.
    static_cast<void>(note_assembly(robot));
    if (!reach(at)) return false;
    include(at);
    return counted() > before;
  }

  /// Evaluates the rows with a pose; excludes those that cannot be evaluated.
  void include(Iterate& at) {
    freeze(at);
    for (int bad; (bad = evaluate(at)) >= 0;) result.status[bad] = Status::singular;
  }

  /// D of every row: of influences as given, of nuisances at the current pose. Fixed in the search:
  /// its change with pose and ξ, times η, is of second order in the ideal level's model error.
  void freeze(const Iterate& at) {
    Knowledge axes = prior;
    const int given = settings.influences;
    axes.count = settings.nuisances;
    axes.column += p - axes.count;
    believe(at.u);
    for (int k : range(log.count))
      if (result.status[k] == Status::ok)
        result.status[k] = acting(robot, axes, at.pose[k],
                                  {given, log.influence + k * readings * given}, H_xi.data(), D[k])
                               .status;
  }

  /// Sets robot, registration, links' unknowns and the amounts of influences and nuisances to those
  /// of u.
  void believe(const std::vector<double>& u) {
    const std::vector<double> change = S * u;  // from the prior means
    amount.assign(change.end() - settings.influences - settings.nuisances, change.end());
    result.xi = mean;
    for (int k : range(p - settings.nuisances))
      if (prior.column[k] >= 0) result.xi[prior.column[k]] += change[k];
    static_cast<void>(set_parameters(drawn, result.xi.data(), robot));  // `finished`: see run()
    result.w = log.links.mean;
    for (std::size_t k = 0; k < result.w.size(); ++k) result.w[k] += change[log.links.first + k];
    if (const int first = settings.registration; first >= 0)
      result.registration = moved(result.start, change.data() + first);
  }

  /// Initial registration, by the first poses.
  Registration initial_registration(const Iterate& at) const {
    const int first = settings.registration;
    if (first < 0 || !log.measured) return log.registration;
    // An unknown marker position includes x, an unknown turn the one about the platform's z.
    const int place = first + 6, turn = first + kRegistration - 1;
    return registered(robot.mobility, log.registration, S(first, first) > 0, S(place, place) > 0,
                      S(turn, turn) > 0, log.count - log.referenced, at.pose.data(),
                      result.status.data(), log.measured);
  }

  /// Finds poses of rows without one, from the motors. @return whether there is a new one
  bool reach(Iterate& at) {
    const Pose home = to_pose(robot.mobility, robot.home);
    Pose guess = home;
    bool more = false;
    for (int k : range(log.count)) {
      Status& status = result.status[k];
      if (status != Status::ok) {
        Joint q{};
        std::copy_n(log.q_e + k * readings, drawn.motors, q.begin());
        for (const Pose& from : {home, guess}) {
          at.pose[k] = from;
          rest[k] = {};
          status = motors_pose(level, robot, q, at.pose[k], rest[k]);
          if (status == Status::ok) break;
        }
        more = more || status == Status::ok;
        if (settings.poll) settings.poll();
      }
      guess = status == Status::ok ? at.pose[k] : home;
    }
    return more;
  }

  /// Evaluates every good row at this geometry and these poses.
  /// @param last  the iterate that this one was reached from, if any
  /// @return the first row that cannot be evaluated, or -1
  int evaluate(Iterate& at, const Iterate* last = nullptr) {
    believe(at.u);
    at.line.resize(log.count);
    for (int k : range(log.count)) {
      at.line[k].rows = 0;
      if (result.status[k] == Status::ok && !settle(at, k, last)) return k;
      if (settings.poll) settings.poll();
    }
    at.block = linked(robot.mobility, log.links, result.w.data(), prior, at.pose, at.line);
    at.weigh(loss, out);
    return -1;
  }

  bool linearise_row(Iterate& at, int k) {
    return linearise_row(at.pose[k], k, prior, D[k], at.line[k]);
  }

  /// @param known, by  as of linearise_line: with more columns than the prior's and D's, or these
  bool linearise_row(const Pose& pose, int k, const Knowledge& known, const RowMatrix& by,
                     Line& line) {
    const bool referenced = k >= log.count - log.referenced;
    Outside outside;
    if (log.measured)
      outside = {log.measured + k * n, log.measured_sigma + k * n,
                 referenced ? &kAligned : &result.registration,
                 referenced ? -1 : settings.registration};
    line.certain = referenced;
    Extended q_e{};
    for (int c : range(readings))
      q_e[c] = log.q_e[k * readings + c] -
               known.sigma[c] * dot(int(amount.size()), by[c], amount.data());
    return bool(linearise_line(level, robot, known, pose, q_e.data(), outside, by, H_xi.data(),
                               line, rest[k]));
  }

  /// Moves row k to a pose of lower misfit, or to any if it has `none`. @return whether it moved
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
      for (int i : range(n)) change[i] = line.e[i] + line.pull[i];
      back_substitute(n, line.R, change);
      bool moves = false;
      for (double length = 1; !moves && length > 0.01; length *= 0.25) {
        moves = lower(at, k, moved(robot.mobility, pose, change));
        for (double& part : change) part *= 0.25;
      }
      if (!moves) break;
    }
    return good;
  }

  Outcome descend(Iterate& now) {
    double damping = 0, current = now.cost(loss);
    double promised = INFINITY;  // gain of the last undamped step
    int last = 0;
    const int freedoms = 1 + equation_count(now.line, now.block);
    while (result.iterations < last_iteration) {
      ++result.iterations;
      auto [information, right] = now.step(loss);
      const double scatter = max(1.0, current / freedoms);  // 1 for a correct model
      for (int k : range(p)) information(k, k) *= 1 + damping;
      const std::vector<double> step = solve_cholesky(cholesky(information), right);
      if (!all_finite(step, p)) return {Status::not_finite};
      Iterate trial{now.u, now.pose, std::vector<Line>(log.count)};
      for (int k : range(p)) trial.u[k] += step[k];
      for (const LinkBlock& block : now.block) pull(block, step, trial.line);
      double moved_by = 0;
      for (int k : range(log.count))
        moved_by = max(moved_by, sqrt(now.line[k].weight(loss)) * follow(now, k, step, trial));
      const double gain =
          dot(p, step.data(), right.data());  // predicted decrease of the cost, at least
      if (damping == 0) promised = gain;
      const bool valid = evaluate(trial, &now) < 0;
      const double next = valid ? trial.cost(loss) : INFINITY;
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
        return {promised < 1e-2 * scatter ? Status::ok : Status::singular};
      } else {
        damping = max(10 * damping, 1e-4);
      }
    }
    return {Status::not_converged};
  }

  /// Moves pose k with the step of ξ: R δx = e - B δu + ν̂. @return largest move in units of its σ
  double follow(const Iterate& now, int k, const std::vector<double>& step, Iterate& trial) const {
    const Line& line = now.line[k];
    if (line.rows < n) return 0;
    Coordinates change{};
    double size = 0;
    for (int i : range(n)) {
      change[i] = line.e[i] - dot(p, line.B[i], step.data()) + trial.line[k].pull[i];
      size = max(size, fabs(change[i]));
    }
    back_substitute(n, line.R, change);
    trial.pose[k] = moved(robot.mobility, now.pose[k], change);
    return size;
  }

  /// The equations of the last step, with a column for an error of each reading.
  void tabulate(const Iterate& at) {
    const int width = p + readings;
    std::vector<std::int32_t> column(prior.column, prior.column + p);
    column.resize(width, -1);
    RowMatrix root = RowMatrix::identity(width);
    for (int i : range(p)) std::copy_n(S[i], p, root[i]);
    const Knowledge wide{width, column.data(), root.data(), prior.sigma};
    std::vector<Line> lines(log.count);
    for (int k : range(log.count)) {
      if (at.line[k].rows < n) continue;
      RowMatrix by(readings, D[k].cols() + readings);
      for (int c : range(readings)) {
        std::copy_n(D[k][c], D[k].cols(), by[c]);
        by(c, D[k].cols() + c) = 1;
      }
      if (linearise_row(at.pose[k], k, wide, by, lines[k])) lines[k].e = at.line[k].e;
    }
    const std::vector<LinkBlock> blocks =
        linked(robot.mobility, log.links, result.w.data(), wide, at.pose, lines);
    LogRows& all = result.rows;
    const int rows = equation_count(lines, blocks);
    all.B = RowMatrix(rows, p), all.D = RowMatrix(rows, readings);
    each_equation(lines, blocks, [&](const double* from, double y, int line, bool linked) {
      const int row = int(all.y.size());
      std::copy_n(from, p, all.B[row]);
      std::copy_n(from + p, readings, all.D[row]);
      all.y.push_back(y);
      all.line.push_back(linked ? -1 : line);
    });
    const std::vector<double> moved = all.B * at.u;
    for (int i : range(rows)) all.y[i] += moved[i];
  }

  void finish(Iterate& at) {
    believe(at.u);
    if (settings.rows) tabulate(at);
    result.cost = at.cost(loss);
    result.u = at.u;
    result.amount.assign(amount.begin(), amount.end() - settings.nuisances);
    result.pose = at.pose;
    result.link.resize(log.links.link.size());
    for (const LinkBlock& block : at.block)
      for (int k : range(block.size())) result.link[block.link[k]].weight = block.weight[k];
    const RowMatrix root = cholesky(at.step(loss).information);
    const int parameters = p - settings.nuisances;
    RowMatrix half(p, parameters);
    for (int i : range(p))
      for (int k : range(parameters)) half(i, k) = S(k, i);
    solve_lower(root, half);
    result.covariance = plus_gram(RowMatrix(parameters, parameters), half);
    for (const LinkBlock& block : at.block) cross_validate(log.links, block, root, result.link);
    for (const Line& line : at.line) {
      const bool good = line.rows >= n;
      result.redundancy.push_back(line.redundancy());
      result.chi2.push_back(good ? line.chi2() : NAN);
      result.weight.push_back(line.redundancy() > 0 ? line.weight(loss) : good);
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
