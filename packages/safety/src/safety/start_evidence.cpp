// What explains the motions of a start-up test: a healthy robot, or one miswiring.
#include "safety/start_evidence.hpp"

namespace truepose::start_detail {
bool same_unit(const Robot& robot, int a, int b) {
  const int n = robot.motors;
  const auto turns = [&](int c) {
    return c < n ? robot.chain[c].actuator == Actuator::revolute
                 : properties(robot.sensor[c - n].kind).unit == Unit::radian;
  };
  return turns(a) == turns(b);
}

StartHypothesis hypothesis(int n, int e, int index) {
  if (index-- == 0) return {};
  for (int a = 0; a < e; index -= e - a, ++a)
    if (index < e - a)
      return index == 0 ? StartHypothesis{StartFinding::scale, a}
                        : StartHypothesis{StartFinding::exchanged, a, a + index};
  return index < n ? StartHypothesis{StartFinding::wrong_way, index}
                   : StartHypothesis{StartFinding::brake_slips, index - n};
}

Real misfit(const StartEvidence& evidence, int n, int e, const StartHypothesis& by,
            StartGain& gain) {
  Real chi2 = 0, ay = 0, aa = 0, yy = 0;
  for (int i = 0; i < evidence.tested; ++i) {
    Extended y = evidence.moved[i], h{}, v;
    if (by.kind == StartFinding::exchanged) std::swap(y[by.a], y[by.b]);
    for (int c = 0; c < e; ++c) v[c] = evidence.noise(i, c);
    h[i] = 1;
    for (int c = n; c < e; ++c) {  // beyond what the other motors' small motions explain
      const auto& g = evidence.g[c - n];
      h[c] = g[i];
      for (int j = 0; j < n; ++j) {
        if (j == i) continue;
        y[c] -= g[j] * y[j];
        v[c] += g[j] * g[j] * v[j];
      }
    }
    const bool gains = by.kind == StartFinding::scale;
    const auto left_out = [&](int c) {
      return c == by.a && (gains || (by.kind == StartFinding::brake_slips && c != i));
    };
    // At a count's edge a motion m below a count is one in every pulse, or none: m (count − m) P².
    const auto variance = [&](int c, Real s) {
      const Real more = c == i ? 0 : (c < n ? kGive : kShape * h[c]) * s;
      const Real most = evidence.pulses[i] * evidence.step[c], motion = std::fabs(h[c] * s);
      return v[c] + more * more + (c < n ? 0 : motion * std::max(most - motion, Real(0)));
    };
    const Real expected = evidence.expected[i];
    Real s = 0, information = 0;
    for (int pass = 0; pass < 2; ++pass) {  // the second one knows s for the tolerances
      Real sum = 0;
      const Real before = s;
      information = 0;
      for (int c = 0; c < e; ++c) {
        if (left_out(c) || h[c] == 0) continue;
        const Real weight = h[c] / variance(c, before);
        sum += weight * y[c];
        information += weight * h[c];
      }
      s = information > 0 ? sum / information : 0;
    }
    const Real size = std::max(expected, std::fabs(s));
    if (!(information * size * size > 1)) {  // no reading has measured it
      s = expected;
      information = 1 / (expected * expected);
    }
    for (int c = 0; c < e; ++c) {
      if (left_out(c)) continue;
      const Real off = y[c] - h[c] * s;
      chi2 += off * off / variance(c, s);
    }
    if (by.kind != StartFinding::wrong_way || by.a != i) {
      const Real end = std::max(s, expected / 10);
      const Real off = s - end, sigma = expected / 20;
      chi2 += off * off / (1 / information + sigma * sigma);
      s = end;
    }
    if (!gains) continue;
    const Real at = h[by.a] * s;
    const Real each = variance(by.a, s) + h[by.a] * h[by.a] / information;
    ay += at * y[by.a] / each;
    aa += at * at / each;
    yy += y[by.a] * y[by.a] / each;
  }
  gain = {};
  if (aa > 0) gain = {ay / aa, 1 / std::sqrt(aa)};
  return chi2 + yy - (aa > 0 ? ay * ay / aa : 0);
}

StartHypothesis verdict(const StartTest& test, const Robot& robot, Real most,
                        std::uint32_t& candidates) {
  const int n = robot.motors, e = n + robot.r;
  const auto fits = [&](const StartHypothesis& by) {
    if (by.kind == StartFinding::exchanged) return same_unit(robot, by.a, by.b);
    return by.a < n || by.kind == StartFinding::scale;
  };
  int best = 0;
  for (int k = 1; k < hypotheses(n, e); ++k)
    if (fits(hypothesis(n, e, k)) && test.misfit[k] < test.misfit[best]) best = k;
  candidates = 0;
  if (test.misfit[0] <= most && test.misfit[best] > test.misfit[0] - kBetter) return {};
  int others = 0;
  const StartHypothesis named_one = hypothesis(n, e, best);
  for (int k = 1; k < hypotheses(n, e); ++k) {
    const StartHypothesis by = hypothesis(n, e, k);
    if (!fits(by) || test.misfit[k] > test.misfit[best] + kNamed) continue;
    candidates |= bit(by.a);
    if (by.b >= 0) candidates |= bit(by.b);
    // Without sensors a reading and its motor cannot be told apart: named as the reading.
    const bool same = by.a == named_one.a && by.a < n && by.kind != StartFinding::exchanged &&
                      named_one.kind != StartFinding::exchanged;
    others += k != best && !same;
    if (same && by.kind == StartFinding::scale) best = k;
  }
  if (others > 0 || test.misfit[best] > most) return {StartFinding::inconsistent, -1, -1};
  return hypothesis(n, e, best);
}
}  // namespace truepose::start_detail
