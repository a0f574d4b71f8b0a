// Online (recursive) calibration, one row of readings per cycle.
#include "estimation/online_calibration.hpp"

#include "math/square.hpp"

namespace truepose::online_detail {
Outcome innovate(const OnlineSettings& settings, const OnlineState& state, int r, const Real* e,
                 Real curvature, const Work& work, Innovations& made) {
  const int p = state.count;
  // A NaN shows in the sum.
  Real sum =
      sum_of(r, [&](int i) { return e[i]; }) + sum_of(r * p, [&](int k) { return work.F[k]; });
  if (!std::isfinite(sum)) return {Status::not_finite, -1};
  made.r = r;
  for (int i = 0; i < r; ++i) {
    made.y[i] = e[i];
    if (settings.linearised)
      for (int k = 0; k < p; ++k)
        made.y[i] -=
            work.F[i * p + k] * (state.xi[state.column[k]] - settings.linearised[state.column[k]]);
  }
  times_root({p, state.column, state.root, state.sigma}, r, work.F);
  // Linearising about a poor ξ̂ leaves a remainder of second order, the square of the loop
  // residual. It counts as noise, so that the first rows do not overstate their information.
  decorrelate(p, work.F, curvature, made);
  // The update must not overflow, nor an equation be as good as certain.
  for (int i = 0; i < r; ++i) {
    sum += 0 * made.y[i] + 0 * made.total[i] + 0 / made.noise[i];
    for (int k = 0; k < p; ++k) sum += 0 * (work.F[i * p + k] / made.noise[i]);
  }
  return {std::isfinite(sum) ? Status::ok : Status::not_finite, -1};
}

namespace {
/// Effect of a payload on the equations free of the pose. @return false without one, or where the
/// Jacobian of the first n motors is singular
bool by_payload(int n, int rows, const ChangeSettings& changes, const Extended& sigma,
                const RowsOfPose& H_x, const Real* G, std::array<Real, kMaxReadings>& loaded) {
  if (changes.load < 0) return false;
  Square transposed{};
  Unknowns size{};
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      transposed[j][i] = H_x[i][j] * sigma[i];
      size[i] += transposed[j][i] * transposed[j][i];
    }
  const Factors factors(n, n, transposed.data(), size);
  if (!factors.regular()) return false;
  const Unknowns torque = factors.solve(changes.force.data());
  for (int i = 0; i < rows - n; ++i)
    loaded[i] = sum_of(
        n, [&](int c) { return G[i * rows + c] * changes.compliance[c] * torque[c] / sigma[c]; });
  return true;
}
}  // namespace

Outcome understand(Level level, const Robot& robot, const OnlineSettings& settings,
                   const Extended& q_e, const OnlineState& state, const Pose& guess, int without,
                   const Work& work, Line& line) {
  const int n = dof(robot.mobility);
  const int rows = readings(robot), p = state.count;
  const Knowledge known{p, state.column, state.root, state.sigma};
  const Joint q = motors_of(robot, q_e);
  Parasitic rest;
  Status status = Status::ok;
  for (const Pose& from : {guess, to_pose(robot.mobility, robot.home)}) {
    line.pose = from;
    status = motors_pose(level, robot, q, line.pose, rest);
    if (status == Status::ok) break;
  }
  if (status != Status::ok) return {status, -1};

  // From the motors' pose to that of all readings, which is farther without a motor.
  std::array<Real, kMaxRows> e;
  for (int steps = without < 0 ? 2 : 5; steps > 0; --steps) {
    const bool last = steps == 1;
    Extended expected, residual;
    PoseRows H_x;
    const Outcome outcome =
        linearise(level, robot, line.pose, expected, H_x, last ? work.H_xi : nullptr, &rest);
    if (!outcome) return outcome;
    innovation(robot, q_e, expected, residual);
    for (int c = 0; c < rows; ++c) {
      const Real weight = c == without ? 0 : 1 / state.sigma[c];
      for (int j = 0; j < n; ++j) line.H_x[c][j] = H_x[c][j] * weight;
      e[c] = residual[c] * weight;
    }
    if (last) gather(robot, known, work.H_xi, rows, work.B);
    RowsOfPose A = line.H_x;
    if (last && without < 0 && state.window && !of_readings(n, rows, A, work.G))
      return {Status::singular, -1};
    if (last && without >= 0) std::fill_n(work.B + without * p, p, 0.0);
    A = line.H_x;
    if (!eliminate(n, rows, A, work.B, last ? p : 0, e)) return {Status::singular, -1};
    Coordinates step{};
    for (int i = 0; i < n; ++i) step[i] = e[i];
    back_substitute(n, A, step);
    if (!all_finite(step, n)) return {Status::not_finite, -1};
    line.pose = moved(robot.mobility, line.pose, step);
  }
  const Real coarsest = *std::max_element(state.sigma.begin(), state.sigma.begin() + rows);
  const Real curvature = settings.linearised ? 0 : kCurvature * coarsest;
  if (without < 0 && state.window) {
    Equations row{rows - n,     rows,     work.F,  work.G + n * rows,
                  e.data() + n, state.xi, nullptr, curvature};
    if (settings.linearised) row.about = settings.linearised;
    std::array<Real, kMaxReadings> loaded;
    if (by_payload(n, rows, settings.changes, known.sigma, line.H_x, row.G, loaded))
      row.loaded = loaded.data();
    add_row(settings.changes, known, row, *state.window, work.trial);
  }
  return innovate(settings, state, rows - n, e.data() + n, curvature, work, line.innovations);
}

void save(const OnlineState& state, Real* kept) {
  const int p = state.count;
  for (int k = 0; k < p; ++k) kept[k] = state.xi[state.column[k]];
  std::copy_n(state.root, p * p, kept + p);
}

void restore(OnlineState& state, const Real* kept) {
  const int p = state.count;
  for (int k = 0; k < p; ++k) state.xi[state.column[k]] = kept[k];
  std::copy_n(kept + p, p * p, state.root);
}

void weigh_line(OnlineState& state, int readings, Real log_ratio) {
  ResidualTest& doubt = state.doubt;
  if (state.kept && doubt.evidence <= 0 && ++doubt.since >= kEvery) {
    save(state, state.kept);
    doubt.since = 0;
  }
  ++doubt.lines;
  doubt.evidence = std::max(0.0, doubt.evidence + std::min(log_ratio, kLineSays));
  if (doubt.evidence <= 0) doubt.blame = {};
  if (!(doubt.evidence > kStop)) return;
  doubt.stopped = true;
  doubt.suspect = outstanding(readings, doubt.blame, kNamed);
  if (state.kept) restore(state, state.kept);
}

void update(const OnlineSettings& settings, const Innovations& made, const Work& work,
            OnlineState& state) {
  const int p = state.count;
  for (int i = 0; i < made.r; ++i) {
    update_root(p, state.root, work.F + i * p, made.noise[i], work.b);
    const Real step = made.y[i] / made.total[i];
    for (int k = 0; k < p; ++k) state.xi[state.column[k]] += work.b[k] * step;
  }
  if (settings.drifts > 0) {  // one per cycle, for all cycles since its last turn
    state.due = (state.due + 1) % settings.drifts;
    const Real cycles = std::sqrt(Real(settings.drifts));
    for (int k = 0; k < p; ++k) work.b[k] = cycles * settings.drift[state.due * p + k];
    add_drift(p, state.root, work.b);
  }
}

}  // namespace truepose::online_detail

namespace truepose {
Outcome observe(Level level, const Robot& drawn, const OnlineSettings& settings,
                const Extended& q_e, OnlineState& state, Robot& robot, Pose& pose, Real* memory) {
  const int n = dof(robot.mobility);
  if (!drawn.finished) return {Status::unfinished, -1};
  const int r = redundancy(drawn), rows = readings(drawn), p = state.count;
  if (!all_finite(q_e, rows)) return {Status::not_finite, -1};
  const online_detail::Work work(drawn, p, memory);
  ResidualTest& doubt = state.doubt;
  const bool gated = settings.gate > 0 && !doubt.stopped;
  if (gated && state.kept && doubt.lines == 0) online_detail::save(state, state.kept);
  const Real* xi = settings.linearised ? settings.linearised : state.xi;
  Outcome outcome = set_parameters(drawn, xi, robot);
  if (!outcome) return outcome;
  online_detail::Line line;
  const auto understand = [&](int without) {
    return online_detail::understand(level, robot, settings, q_e, state, pose, without, work, line);
  };
  outcome = understand(-1);
  if (!outcome) {
    if (gated && online_detail::no_pose(outcome.status))
      online_detail::weigh_line(state, rows, kLineSays);
    return outcome;
  }
  Pose found = line.pose;
  bool learns = !doubt.stopped;
  if (gated && r > 0) {
    const Real chi2 = line.innovations.chi2();
    Real log_ratio = 0.5 * ((1 - 1 / kWorse) * chi2 - r * std::log(kWorse));
    if (!(chi2 <= beyond(settings.gate, r))) {
      log_ratio = kLineSays;
      learns = false;
      Extended by{};
      if (explained(n, line.H_x, line.innovations, by)) {
        const int wrong = r > 1 ? outstanding(rows, by, beyond(settings.gate, 1)) : -1;
        learns = wrong >= 0 && understand(wrong) &&
                 line.innovations.chi2() <= beyond(settings.gate, r - 1);
        if (learns) {
          found = line.pose;
          outcome.chain = wrong;
          doubt.blame[wrong] += 1;
        }
      }
      outcome.status = Status::disagree;
    }
    online_detail::weigh_line(state, rows, log_ratio);
  }
  pose = found;
  if (doubt.stopped) return {Status::stopped, -1};
  if (!learns) return outcome;

  online_detail::update(settings, line.innovations, work, state);
  return outcome;
}
}  // namespace truepose
