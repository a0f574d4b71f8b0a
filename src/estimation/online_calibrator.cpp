// Online calibration beside the control cycle.
#include "estimation/online_calibrator.hpp"

#include <utility>

#include "estimation/linearise.hpp"

namespace truepose {
namespace {
using online_detail::restore, online_detail::save;

constexpr int kSoon = 10;  ///< rows within which disagreement stops the filter

/// σ of every reading's own error before changes of its noise.
const Extended& first_sigma(const OnlineState& state) {
  return state.window ? state.window->sigma : state.sigma;
}

Outcome learn(Level level, OnlineCalibrator& learner, const Extended& q_e) {
  const Pose before = learner.pose;
  const Outcome outcome = observe(level, *learner.drawn, learner.settings, q_e, learner.state,
                                  learner.robot, learner.pose, learner.work);
  if (outcome.status == Status::disagree && outcome.chain < 0) learner.pose = before;
  return outcome;
}

/// Starts a window at the filter's state.
void begin_window(OnlineCalibrator& learner) {
  OnlineState& state = learner.state;
  Window& window = *state.window;
  const ChangeSettings& changes = learner.settings.changes;
  const int m = readings(*learner.drawn);
  save(state, window.base);
  window.before = state.sigma;
  std::fill_n(window.share, changes.count, 0.0);
  std::copy(window.stored + window.next * m, window.stored + window.last * m, window.stored);
  window.last -= std::exchange(window.next, 0);
  window.openings = window.passes = 0;
  window.moved = 0;
  learner.settings.linearised = nullptr;
  restart(changes, m, state.count, window, learner.work);
}

/// Starts the filter anew on the window's rows.
void replay(OnlineCalibrator& learner, const Real* about) {
  OnlineState& state = learner.state;
  Window& window = *state.window;
  restart(learner.settings.changes, readings(*learner.drawn), state.count, window, learner.work);
  if (about) std::copy_n(about, parameter_count(*learner.drawn), window.about);
  learner.settings.linearised = about ? window.about : nullptr;
  restore(state, window.mean);
  state.doubt = {};
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
void conclude(OnlineCalibrator& learner) {
  OnlineState& state = learner.state;
  Window& window = *state.window;
  const int m = readings(*learner.drawn);
  Finding finding = decide(learner.settings.changes, m, window, state.sigma);
  const ChangeKind kind = finding.likeliest.kind;
  finding.likeliest.row = learner.lines + learner.left_out;
  if (finding.decisive && kind != ChangeKind::fault && window.openings < kOpenings) {
    window.opened[window.openings++] = finding.likeliest;
    window.passes = kind == ChangeKind::part ? 2 : 1;
    window.goal = window.last;
    return replay(learner, nullptr);
  }
  if (finding.decisive || !finding.fits) {  // a fault, or nothing explains the rows
    const bool fault = finding.decisive && kind == ChangeKind::fault;
    if (window.suspect < 0 && fault) window.suspect = finding.likeliest.which;
    report_fault(window, finding.likeliest);
    state.sigma = window.before;
    restore(state, window.base);
    state.doubt.stopped = true;
    state.doubt.suspect = window.suspect;
    return begin_window(learner);
  }
  if (state.doubt.stopped && finding.unchanged) {  // the rows agree again
    restore(state, window.mean);
    state.doubt = {};
    window.suspect = -1;
    window.fault = false;
  }
  if (window.openings > 0) window.suspect = -1;
  for (int k = 0; k < window.openings; ++k) report(window, window.opened[k]);
  if (window.next >= kWindow || window.openings > 0) begin_window(learner);
}

/// Makes `robot` that at ξ̂; of one in use, nearer to it, but as it was while rows wait.
Outcome publish(Level level, OnlineCalibrator& learner) {
  const Robot& drawn = *learner.drawn;
  const Real* xi = learner.state.xi;
  Real* const in_use = learner.in_use;
  if (!in_use) return set_parameters(drawn, xi, learner.robot);
  Outcome outcome = set_parameters(drawn, in_use, learner.robot);
  const int width = parameter_count(drawn);
  if (!outcome || replaying(learner) || std::equal(in_use, in_use + width, xi)) return outcome;
  Extended expected;
  PoseRows H_x;
  Parasitic rest;
  Real* const H_xi = learner.work;
  outcome = linearise(level, learner.robot, learner.pose, expected, H_x, H_xi, &rest);
  if (!outcome) return outcome;
  Real share = 1;
  const Extended& sigma = first_sigma(learner.state);
  for (int c = 0; c < drawn.motors; ++c) {
    const Real jump =
        sum_of(width, [&](int k) { return H_xi[c * width + k] * (xi[k] - in_use[k]); });
    const Real most = kJump * sigma[c];
    if (std::fabs(jump) > most) share = std::min(share, most / std::fabs(jump));
  }
  for (int k = 0; k < width; ++k)
    in_use[k] = share < 1 ? in_use[k] + share * (xi[k] - in_use[k]) : xi[k];
  return set_parameters(drawn, in_use, learner.robot);
}

/// Processes the next stored row. @return its outcome
Outcome advance(Level level, OnlineCalibrator& learner) {
  OnlineState& state = learner.state;
  Window& window = *state.window;
  const int m = readings(*learner.drawn);
  Extended q_e{};
  std::copy_n(window.stored + window.next * m, m, q_e.begin());
  const bool stopped = state.doubt.stopped;
  const Outcome outcome = learn(level, learner, q_e);
  ++window.next;
  if (state.doubt.stopped && !stopped) window.suspect = state.doubt.suspect;
  if (window.passes > 0) {
    if (window.next < window.goal) return outcome;
    const bool again = --window.passes > 0;
    learner.settings.linearised = nullptr;
    if (again)
      replay(learner, state.xi);
    else
      conclude(learner);
  } else if (state.doubt.stopped && !stopped && window.next > kSoon) {
    begin_window(learner);  // it has just changed: the rows before say nothing of it
  } else if (window.next % kDecide == 0) {
    conclude(learner);
  }
  return outcome;
}
}  // namespace

Outcome calibrate_online(Level level, OnlineCalibrator& learner, const Extended& q_e) {
  if (!learner.drawn->finished) return {Status::unfinished, -1};
  OnlineState& state = learner.state;
  Window* const window = state.window;
  const int m = readings(*learner.drawn);
  bool news = learner.lines + learner.left_out == 0;
  for (int c = 0; c < m; ++c)
    news = news || std::fabs(q_e[c] - learner.last[c]) > learner.fresh * first_sigma(state)[c];
  Outcome outcome = learner.made;
  if (window) {
    if (window->last == 0) begin_window(learner);
    if (news && !all_finite(q_e, m)) return {Status::not_finite, -1};
    if (window->last == kStored) news = false;  // no room yet: the row is new in the next cycle
    if (news) std::copy_n(q_e.begin(), m, window->stored + window->last++ * m);
    if (!replaying(learner)) {
      const Outcome believed = publish(level, learner);
      return believed ? outcome : believed;
    }
    for (int k = 0; k < kReplayed && replaying(learner); ++k) outcome = advance(level, learner);
  } else {
    if (state.doubt.stopped) return {Status::stopped, -1};
    if (!news) return outcome;
    outcome = learn(level, learner, q_e);
  }
  const Outcome believed = publish(level, learner);
  if (!believed) return believed;
  if (!news) return learner.made = outcome;
  if (outcome.status != Status::not_finite) {  // a bad row, too, counts once
    learner.last = q_e;
    learner.made = outcome;
  }
  ++(outcome.status == Status::ok ? learner.lines : learner.left_out);
  return outcome;
}

Outcome roll_back(OnlineCalibrator& learner) {
  OnlineState& state = learner.state;
  if (!state.kept || state.doubt.lines == 0) return {};
  restore(state, state.kept);
  state.doubt.evidence = 0;
  state.doubt.blame = {};
  state.doubt.since = 0;
  if (state.window) begin_window(learner);
  if (learner.in_use) std::copy_n(state.xi, parameter_count(*learner.drawn), learner.in_use);
  return publish(level_of(*learner.drawn), learner);
}
}  // namespace truepose
