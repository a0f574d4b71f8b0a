// Online calibration beside the control cycle.
#include "estimation/online_calibrator.hpp"

#include <utility>

#include "estimation/linearise.hpp"

namespace truepose {
namespace {
constexpr int kSoon = 10;  ///< rows within which disagreement stops the filter

/// σ of every reading's own error before changes of its noise.
const Extended& first_sigma(const OnlineState& state) {
  return state.window ? state.window->sigma : state.sigma;
}

/// Processes a row.
Outcome process(Level level, OnlineCalibrator& calibrator, const Extended& q_e) {
  const Pose before = calibrator.pose;
  const Outcome outcome = observe(level, calibrator, q_e);
  if (outcome.status == Status::disagree && outcome.chain < 0) calibrator.pose = before;
  return outcome;
}

/// Starts a window at the filter's state.
void begin_window(OnlineCalibrator& calibrator) {
  OnlineState& state = calibrator.state;
  Window& window = *state.window;
  const ChangeSettings& changes = calibrator.settings.changes;
  const int m = readings(*calibrator.drawn);
  window.base.assign(state);
  window.before = state.sigma;
  std::fill_n(window.share, changes.steps, 0.0);
  std::copy(window.stored + window.next * m, window.stored + window.last * m, window.stored);
  window.last -= std::exchange(window.next, 0);
  window.openings = window.passes = 0;
  window.moved = 0;
  calibrator.settings.linearised = nullptr;
  restart(changes, m, window, calibrator.work);
}

/// Continues at another estimate, without evidence of disagreement.
void resume(const RootFilter& at, OnlineState& state) {
  state.assign(at);
  state.kept.assign(at);
  state.test = {};
}

/// Starts the filter anew on the window's rows.
void replay(OnlineCalibrator& calibrator, const Real* about) {
  OnlineState& state = calibrator.state;
  Window& window = *state.window;
  restart(calibrator.settings.changes, readings(*calibrator.drawn), window, calibrator.work);
  if (about) std::copy_n(about, parameter_count(*calibrator.drawn), window.about);
  calibrator.settings.linearised = about ? window.about : nullptr;
  resume(window.filter, state);
  window.next = 0;
}

void report(Window& window, const Recognised& change) {
  window.news[window.recognised++ % kNews] = change;
}

/// Reports a fault, or rows that nothing explains, once for as long as it goes on.
void report_fault(Window& window, Recognised fault) {
  fault.kind = window.suspect < 0 ? ChangeKind::unexplained : ChangeKind::fault;
  fault.which = window.suspect;
  const Recognised& last = window.news[(window.recognised + kNews - 1) % kNews];
  if (!std::exchange(window.fault, true) || last.kind != fault.kind || last.which != fault.which)
    report(window, fault);
}

/// Decides over the rows of the window so far.
void conclude(OnlineCalibrator& calibrator) {
  OnlineState& state = calibrator.state;
  Window& window = *state.window;
  const int m = readings(*calibrator.drawn);
  Finding finding = decide(calibrator.settings.changes, m, window, state.sigma);
  const ChangeKind kind = finding.likeliest.kind;
  finding.likeliest.row = calibrator.lines + calibrator.left_out;
  if (finding.decisive && kind != ChangeKind::fault && window.openings < kOpenings) {
    window.opened[window.openings++] = finding.likeliest;
    window.passes = kind == ChangeKind::part ? 2 : 1;
    window.goal = window.last;
    return replay(calibrator, nullptr);
  }
  if (finding.decisive || !finding.fits) {  // a fault, or nothing explains the rows
    const bool fault = finding.decisive && kind == ChangeKind::fault;
    if (window.suspect < 0 && fault) window.suspect = finding.likeliest.which;
    report_fault(window, finding.likeliest);
    state.sigma = window.before;
    state.assign(window.base);
    state.test.stopped = true;
    state.test.suspect = window.suspect;
    return begin_window(calibrator);
  }
  if (state.test.stopped && finding.unchanged) {  // the rows agree again
    resume(window.filter, state);
    window.suspect = -1;
    window.fault = false;
  }
  if (window.openings > 0) window.suspect = -1;
  for (int k : range(window.openings)) report(window, window.opened[k]);
  if (window.next >= kWindow || window.openings > 0) begin_window(calibrator);
}

/// Makes `robot` that at ξ̂; of one in use, nearer to it, but as it was while rows wait.
Outcome publish(Level level, OnlineCalibrator& calibrator) {
  const Robot& drawn = *calibrator.drawn;
  const Real* xi = calibrator.state.xi;
  Real* const in_use = calibrator.in_use;
  if (!in_use) return set_parameters(drawn, xi, calibrator.robot);
  Outcome outcome = set_parameters(drawn, in_use, calibrator.robot);
  const int width = parameter_count(drawn);
  if (!outcome || replaying(calibrator) || std::equal(in_use, in_use + width, xi)) return outcome;
  Extended expected;
  PoseRows H_x;
  Parasitic rest;
  Real* const H_xi = calibrator.work;
  outcome = linearise(level, calibrator.robot, calibrator.pose, expected, H_x, H_xi, &rest);
  if (!outcome) return outcome;
  Real share = 1;
  const Extended& sigma = first_sigma(calibrator.state);
  for (int c : range(drawn.motors)) {
    const Real jump =
        sum_of(width, [&](int k) { return H_xi[c * width + k] * (xi[k] - in_use[k]); });
    const Real most = kJump * sigma[c];
    if (fabs(jump) > most) share = min(share, most / fabs(jump));
  }
  for (int k : range(width))
    in_use[k] = share < 1 ? in_use[k] + share * (xi[k] - in_use[k]) : xi[k];
  return set_parameters(drawn, in_use, calibrator.robot);
}

/// Processes the next stored row. @return its outcome
Outcome advance(Level level, OnlineCalibrator& calibrator) {
  OnlineState& state = calibrator.state;
  Window& window = *state.window;
  const int m = readings(*calibrator.drawn);
  Extended q_e{};
  copy_first(m, window.stored + window.next * m, q_e);
  const bool stopped = state.test.stopped;
  const Outcome outcome = process(level, calibrator, q_e);
  ++window.next;
  if (state.test.stopped && !stopped) window.suspect = state.test.suspect;
  if (window.passes > 0) {
    if (window.next < window.goal) return outcome;
    const bool again = --window.passes > 0;
    calibrator.settings.linearised = nullptr;
    if (again)
      replay(calibrator, state.xi);
    else
      conclude(calibrator);
  } else if (state.test.stopped && !stopped && window.next > kSoon) {
    begin_window(calibrator);  // it has just changed: the rows before say nothing of it
  } else if (window.next % kDecide == 0) {
    conclude(calibrator);
  }
  return outcome;
}
}  // namespace

Outcome start(const Robot& drawn, const Knowledge& prior, Real* memory,
              OnlineCalibrator& calibrator) {
  const int p = prior.count, width = parameter_count(drawn);
  const auto next = [&]() -> RootFilter {
    Real* const xi = std::exchange(memory, memory + width + p * p);
    return {p, prior.column, xi, xi + width};
  };
  OnlineState& state = calibrator.state;
  state = {next(), prior.sigma, 0, next()};
  const Outcome outcome = drawn_parameters(drawn, state.xi);
  std::copy_n(prior.root, p * p, state.root);
  state.kept.assign(state);
  calibrator.drawn = &drawn;
  calibrator.work = memory;
  calibrator.robot = drawn;
  calibrator.pose = to_pose(drawn.mobility, drawn.home);
  return outcome;
}

void follow(const ChangeSettings& changes, Real* memory, Window& window,
            OnlineCalibrator& calibrator) {
  OnlineState& state = calibrator.state;
  const int width = parameter_count(*calibrator.drawn);
  calibrator.settings.changes = changes;
  calibrator.in_use = memory;
  std::copy_n(state.xi, width, memory);
  window = {};
  lay_out(*calibrator.drawn, state, changes, memory + width, window);
  window.sigma = state.sigma;
  state.window = &window;
}

Outcome calibrate_online(Level level, OnlineCalibrator& calibrator, const Extended& q_e) {
  if (!calibrator.drawn->finished) return {Status::unfinished};
  OnlineState& state = calibrator.state;
  Window* const window = state.window;
  const int m = readings(*calibrator.drawn);
  bool news = calibrator.lines + calibrator.left_out == 0;
  for (int c : range(m))
    news = news || fabs(q_e[c] - calibrator.last[c]) > calibrator.fresh * first_sigma(state)[c];
  Outcome outcome = calibrator.made;
  if (window) {
    if (window->last == 0) begin_window(calibrator);
    if (news && !all_finite(q_e, m)) return {Status::not_finite};
    if (window->last == kStored) news = false;  // no room yet: the row is new in the next cycle
    if (news) copy_first(m, q_e, window->stored + window->last++ * m);
    if (!replaying(calibrator)) {
      const Outcome believed = publish(level, calibrator);
      return believed ? outcome : believed;
    }
    for (int k = 0; k < kReplayed && replaying(calibrator); ++k)
      outcome = advance(level, calibrator);
  } else {
    if (state.test.stopped) return {Status::stopped};
    if (!news) return outcome;
    outcome = process(level, calibrator, q_e);
  }
  const Outcome believed = publish(level, calibrator);
  if (!believed) return believed;
  if (!news) return calibrator.made = outcome;
  if (outcome.status != Status::not_finite) {  // a bad row, too, counts once
    calibrator.last = q_e;
    calibrator.made = outcome;
  }
  ++(outcome.status == Status::ok ? calibrator.lines : calibrator.left_out);
  return outcome;
}

Outcome roll_back(OnlineCalibrator& calibrator) {
  OnlineState& state = calibrator.state;
  if (!(calibrator.settings.gate > 0)) return {};
  state.assign(state.kept);
  state.test.cusum = 0;
  state.test.faulty = {};
  state.test.since = 0;
  if (state.window) begin_window(calibrator);
  if (calibrator.in_use)
    std::copy_n(state.xi, parameter_count(*calibrator.drawn), calibrator.in_use);
  return publish(level_of(*calibrator.drawn), calibrator);
}
}  // namespace truepose
