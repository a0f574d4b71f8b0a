// Online (recursive) calibration, one row of readings per cycle.
#include "estimation/online_calibration.hpp"

#include "math/square.hpp"

namespace truepose {
namespace {
/// Effect of a payload on the equations free of the pose. @return false without one, or where the
/// Jacobian of the first n motors is singular
bool by_payload(int n, int rows, const ChangeSettings& changes, const Extended& sigma,
                const RowsOfPose& H_x, const Real* G, std::array<Real, kMaxReadings>& loaded) {
  if (changes.load < 0) return false;
  Square transposed{};
  Unknowns size{};
  for (int i : range(n))
    for (int j : range(n)) {
      transposed[j][i] = H_x[i][j] * sigma[i];
      size[i] += transposed[j][i] * transposed[j][i];
    }
  const Factors factors(n, n, transposed.data(), size);
  if (!factors.regular()) return false;
  const Unknowns torque = factors.solve(changes.force.data());
  for (int i : range(rows - n))
    loaded[i] = sum_of(
        n, [&](int c) { return G[i * rows + c] * changes.compliance[c] * torque[c] / sigma[c]; });
  return true;
}

/// One cycle.
struct Cycle {
  const Level level;
  OnlineCalibrator& of;
  const Extended& q_e;

  const Robot& robot = of.robot;
  const OnlineSettings& settings = of.settings;
  OnlineState& state = of.state;
  const int n = dof(robot.mobility), readings = truepose::readings(robot);
  Real* const H_xi = of.work;
  Real* const B = H_xi + readings * parameter_count(robot);
  Real* const G = B + readings * state.count;
  Real* const F = G + readings * readings;
  Real* const gain = F + redundancy(robot) * state.count;
  Pose pose{};         ///< x̂
  Innovations made{};  ///< of the equations about ξ

  /// Innovations of a row, by linearising about a pose of all readings.
  /// @param without  excluded reading, or -1
  [[gnu::noinline]] Outcome innovations(int without) {  // its stack is not needed later
    const Knowledge known{state.count, state.column, state.root, state.sigma};
    const bool whole = without < 0;
    Extended used = q_e;
    if (!whole) used[without] = NAN;
    Parasitic rest;
    Status status = Status::ok;
    for (const Pose& from : {of.pose, to_pose(robot.mobility, robot.home)}) {
      pose = from;
      status = motors_pose(level, robot, motors_of(robot, q_e), pose, rest);
      if (status == Status::ok) break;
    }
    if (status != Status::ok) return {status, -1};

    // From the motors' pose to that of all readings, which is farther without a motor.
    ReadingRow row;
    RowsOfPose H_x;  // whitened
    for (int steps = whole ? 2 : 5; steps > 0; --steps) {
      const bool last = steps == 1;
      const Outcome outcome = linearise_row(level, robot, known, pose, used.data(),
                                            last ? H_xi : nullptr, B, row, rest);
      if (!outcome) return outcome;
      H_x = row.R;
      if ((last && whole && !of_readings(n, row.rows, H_x, G)) ||
          !eliminate(n, row.rows, row.R, B, last ? state.count : 0, row.e))
        return {Status::singular};
      Coordinates step{};
      copy_first(n, row.e, step);
      back_substitute(n, row.R, step);
      if (!all_finite(step, n)) return {Status::not_finite};
      pose = moved(robot.mobility, pose, step);
    }
    const Real coarsest = *std::max_element(state.sigma.begin(), state.sigma.begin() + readings);
    const Real curvature = settings.linearised ? 0 : kCurvature * coarsest;
    Equations equations{
        row.rows - n,     row.rows,         B + n * state.count,
        G + n * row.rows, row.e.data() + n, settings.linearised ? settings.linearised : state.xi,
        nullptr,          curvature};
    if (whole && state.window) {
      std::array<Real, kMaxReadings> loaded;
      if (by_payload(n, row.rows, settings.changes, state.sigma, H_x, equations.G, loaded))
        equations.loaded = loaded.data();
      add_row(settings.changes, state.sigma, equations, *state.window, F);
    }
    return innovate(state, equations, F, made);
  }

  /// Innovations without the one reading that alone explains a contradiction of r equations, if
  /// there is one. @return whether the other readings agree
  bool isolate(int r, int& faulty) {
    if (r < 2) return false;
    Extended by{};  // decrease of χ² by an error of each reading
    for (int c : range(readings)) {
      std::array<Real, kMaxReadings> g;
      for (int i : range(r)) g[i] = G[(n + i) * readings + c];
      by[c] = made.transform(g).chi2();
    }
    const int suspect = outstanding(readings, by, beyond(settings.gate, 1));
    if (suspect < 0 || !innovations(suspect) || !(made.chi2() <= beyond(settings.gate, r - 1)))
      return false;
    faulty = suspect;
    state.test.faulty[faulty] += 1;
    return true;
  }

  /// Adds a row to the evidence of disagreement. Without evidence, the state before this row is
  /// saved; with too much, the saved one is restored.
  void test(Real log_ratio) {
    ResidualTest& test = state.test;
    if (test.cusum <= 0 && ++test.since >= kSavePeriod) {
      state.kept.assign(state);
      test.since = 0;
    }
    ++test.lines;
    test.cusum = max(0.0, test.cusum + min(log_ratio, kMostLogRatio));
    if (test.cusum <= 0) test.faulty = {};
    if (!(test.cusum > kThreshold)) return;
    test.stopped = true;
    test.suspect = outstanding(readings, test.faulty, kIsolates);
    state.assign(state.kept);
  }

  /// One random walk per cycle, for all cycles since its last turn.
  void drift() {
    const ChangeSettings& by = settings.changes;
    if (by.drifts < 1) return;
    state.due = (state.due + 1) % by.drifts;
    const Real cycles = sqrt(Real(by.drifts));
    const int p = state.count;
    for (int k : range(p)) gain[k] = cycles * by.drift[state.due * p + k];
    add_drift(p, state.root, gain);
  }
};
}  // namespace

Outcome observe(Level level, OnlineCalibrator& of, const Extended& q_e) {
  const Robot& drawn = *of.drawn;
  if (!drawn.finished) return {Status::unfinished};
  const int r = redundancy(drawn);
  if (!all_finite(q_e, readings(drawn))) return {Status::not_finite};
  const OnlineSettings& settings = of.settings;
  OnlineState& state = of.state;
  const bool gated = settings.gate > 0 && !state.test.stopped;
  Outcome outcome =
      set_parameters(drawn, settings.linearised ? settings.linearised : state.xi, of.robot);
  if (!outcome) return outcome;
  Cycle cycle{level, of, q_e};
  outcome = cycle.innovations(-1);
  if (!outcome) {
    if (gated && (outcome.status == Status::unreachable || outcome.status == Status::not_converged))
      cycle.test(kMostLogRatio);
    return outcome;
  }
  Pose found = cycle.pose;
  bool updates = !state.test.stopped;
  if (gated && r > 0) {
    const Real chi2 = cycle.made.chi2();
    Real log_ratio = 0.5 * ((1 - 1 / kVarianceRatio) * chi2 - r * log(kVarianceRatio));
    if (!(chi2 <= beyond(settings.gate, r))) {
      log_ratio = kMostLogRatio;
      outcome.status = Status::disagree;
      updates = cycle.isolate(r, outcome.chain);
      if (updates) found = cycle.pose;
    }
    cycle.test(log_ratio);
  }
  of.pose = found;
  if (state.test.stopped) return {Status::stopped};
  if (!updates) return outcome;
  update(cycle.made, cycle.F, state, cycle.gain);
  cycle.drift();
  return outcome;
}
}  // namespace truepose
