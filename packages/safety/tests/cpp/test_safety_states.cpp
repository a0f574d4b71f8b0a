// The safety shell's state machine: every state with every finding.
#include <algorithm>
#include <string>
#include <vector>

#include "check.hpp"
#include "safety/safety_states.hpp"

using namespace truepose;

namespace {

constexpr int kFindings = 1 << 8;

SafetyFindings findings(int k) {
  const auto has = [&](int position) { return (k >> position & 1) != 0; };
  return {has(0), has(1), has(2), has(3), has(4), has(5), has(6), has(7)};
}

bool brakes_open(const SafetyMachine& machine) {
  return machine.state == SafetyState::running ||
         (machine.state == SafetyState::stopping && machine.stop == StopKind::path);
}

bool healthy(const SafetyFindings& found) { return found.healthy && !found.violated; }

/// A statement about every transition from `before` by `found` to `after`.
#define TEST_TRANSITION(statement)                                                      \
  static void CHECK_JOIN(each_, __LINE__)(const SafetyMachine&, const SafetyFindings&,  \
                                          const SafetyMachine&);                        \
  TEST(statement) { for_each_transition(CHECK_JOIN(each_, __LINE__)); }                 \
  static void CHECK_JOIN(each_, __LINE__)([[maybe_unused]] const SafetyMachine& before, \
                                          [[maybe_unused]] const SafetyFindings& found, \
                                          [[maybe_unused]] const SafetyMachine& after)

/// Calls f(before, findings, after) for every machine that can be reached from switching on.
template <class F>
int for_each_transition(F&& f) {
  std::vector<SafetyMachine> reached{SafetyMachine{}};
  for (std::size_t k = 0; k < reached.size(); ++k)
    for (int of = 0; of < kFindings; ++of) {
      const SafetyMachine before = reached[k], after = next(before, findings(of));
      f(before, findings(of), after);
      if (std::find(reached.begin(), reached.end(), after) == reached.end())
        reached.push_back(after);
    }
  return static_cast<int>(reached.size());
}

}  // namespace

TEST("eight machines can be reached: five states, and how `stopping` stops and why") {
  const int reached = for_each_transition([](const auto&, const auto&, const auto& after) {
    CHECK((after.stop != StopKind::none) == (after.state == SafetyState::stopping));
    if (after.state != SafetyState::stopping)
      CHECK(after.violated == (after.state == SafetyState::fault));
  });
  CHECK(reached == 8);
}

TEST_TRANSITION("a violation or a stop request stops a running robot in the same cycle") {
  if (before.state != SafetyState::running) return;
  CHECK((after.state == SafetyState::stopping) == (found.violated || found.stop));
  CHECK(after.state == SafetyState::stopping || after.state == SafetyState::running);
  CHECK(after.violated == found.violated);
}

TEST_TRANSITION("a stop with an untrusted motor in the loop is by brake") {
  if (after.stop == StopKind::path) CHECK(found.trusted);
  if (before.stop == StopKind::path && !found.trusted) CHECK(after.stop == StopKind::brake);
  if (before.stop == StopKind::brake) CHECK(after.stop != StopKind::path);
}

TEST_TRANSITION("a stop ends with closed brakes, and a violation during it is not lost") {
  if (before.state != SafetyState::stopping) return;
  const bool violated = before.violated || found.violated;
  if (after.state == SafetyState::stopping) {
    CHECK(after.violated == violated);
    if (before.stop == StopKind::path && found.path_ended) CHECK(after.stop == StopKind::brake);
    return;
  }
  CHECK(before.stop == StopKind::brake && found.brakes_closed);
  CHECK(after.state == (violated ? SafetyState::fault : SafetyState::stopped));
}

TEST_TRANSITION("a stop ends after at most two findings, whatever else is found") {
  if (before.state != SafetyState::stopping) return;
  SafetyFindings ended = found;
  ended.path_ended = ended.brakes_closed = true;
  const SafetyMachine first = next(before, ended), second = next(first, ended);
  CHECK(first.state != SafetyState::stopping || second.state != SafetyState::stopping);
}

TEST_TRANSITION("no brake opens but by a start in `ready`, with a healthy check") {
  if (brakes_open(before) || !brakes_open(after)) return;
  CHECK(before.state == SafetyState::ready && after.state == SafetyState::running);
  CHECK(found.start && healthy(found) && !found.stop);
}

TEST_TRANSITION("stopped and fault are latched until acknowledged, and healthy in that cycle") {
  if (before.state == SafetyState::fault)
    CHECK(after.state == SafetyState::fault || after.state == SafetyState::ready);
  if (before.state == SafetyState::stopped)
    CHECK(after.state != SafetyState::running && after.state != SafetyState::stopping);
  if (after.state != SafetyState::ready || before.state == SafetyState::ready) return;
  CHECK(before.state == SafetyState::stopped || before.state == SafetyState::fault);
  CHECK(found.acknowledge && healthy(found) && !found.stop);
}

TEST_TRANSITION("a violation with closed brakes is a fault") {
  const bool rests = before.state == SafetyState::ready || before.state == SafetyState::stopped;
  if (rests && found.violated) CHECK(after.state == SafetyState::fault);
  if (rests && !found.violated) CHECK(after.state != SafetyState::fault);
}

TEST("a machine in no state is a fault, from which only an acknowledgement leads") {
  for (const int state : {-1, 5, 1 << 20})
    for (int of = 0; of < kFindings; ++of) {
      const SafetyMachine broken{static_cast<SafetyState>(state)};
      CHECK(next(broken, findings(of)).state == SafetyState::fault);
    }
}
