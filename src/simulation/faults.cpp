// Readings of faulty sensors.
#include "simulation/faults.hpp"

namespace truepose {
FaultyReadings::FaultyReadings(const std::vector<Fault>& faults, double period, std::uint64_t seed)
    : period_(period), random_(seed) {
  for (const Fault& fault : faults) state_.push_back({fault, {}, 0, false});
}

void FaultyReadings::make_faulty(double time, Extended& q_e) {
  for (State& state : state_) apply(time, state, q_e);
}

bool FaultyReadings::frozen(double time) const {
  return std::ranges::any_of(
      state_, [time](const State& state) { return state.fault.frame && acts(time, state.fault); });
}

double FaultyReadings::amplification() const {
  double most = 1;
  for (const State& state : state_)
    if (state.fault.kind == FaultKind::gain) most *= max(1.0, fabs(state.fault.size));
  return most;
}

bool FaultyReadings::acts(double time, const Fault& fault) {
  return time >= fault.begin - kClock && time < fault.end - kClock;
}

void FaultyReadings::apply(double time, State& state, Extended& q_e) {
  const Fault& fault = state.fault;
  const double healthy = q_e[fault.reading];
  double& read = q_e[fault.reading];
  if (fault.kind == FaultKind::delay) remember(healthy, state);
  if (!acts(time, fault)) return;
  const bool first = !state.began;
  state.began = true;
  switch (fault.kind) {
    case FaultKind::bias:
    case FaultKind::jump: read += fault.size; break;
    case FaultKind::spike: read += first ? fault.size : 0; break;
    case FaultKind::stuck:
      if (first) state.past.assign(1, healthy);
      read = state.past[0];
      break;
    case FaultKind::dropout: read = std::numeric_limits<double>::quiet_NaN(); break;
    case FaultKind::drift: read += fault.size * (time - fault.begin); break;
    case FaultKind::sign: read = -healthy; break;
    case FaultKind::gain: read *= fault.size; break;
    case FaultKind::delay: read = state.past[(state.newest + 1) % state.past.size()]; break;
    case FaultKind::swap: std::swap(read, q_e[fault.other]); break;
    case FaultKind::noise:
      read += std::normal_distribution<double>(0, 1)(random_) * fault.size;
      break;
    case FaultKind::coarse: read = quantized(read, fault.size * fault.count); break;
    case FaultKind::hold:
      if (first || time >= state.since + fault.size - kClock) {
        state.past.assign(1, healthy);
        state.since = time;
      }
      read = state.past[0];
      break;
    case FaultKind::loose:
      if (state.open == 0 && std::bernoulli_distribution(kOpens)(random_))
        state.open = std::uniform_int_distribution<int>(1, kOpen)(random_);
      if (state.open > 0) read = 0;
      state.open = max(0, state.open - 1);
      break;
  }
}

void FaultyReadings::remember(double healthy, State& state) const {
  if (state.past.empty()) {
    const double late = std::ceil(state.fault.size / period_ - 1e-6);  // in periods
    state.past.assign(1 + std::size_t(clamp<double>(late, 0, kMostLate)), healthy);
  }
  state.newest = (state.newest + 1) % state.past.size();
  state.past[state.newest] = healthy;
}
}  // namespace truepose
