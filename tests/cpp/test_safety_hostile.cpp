// The safety shell in every state with every reading, and in hostile cycles.
#include "guarded.hpp"

using namespace pivots_tested;

namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr long kHostile = 2'000'000;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
constexpr long kHostile = 2'000'000;
#else
constexpr long kHostile = 10'000'000;
#endif
#else
constexpr long kHostile = 10'000'000;
#endif

}  // namespace

TEST("every state with every reading: healthy, implausible, missing, contradictory") {
  for_some_guarded([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    // Every state that can be reached, and the releasing of the brakes.
    std::vector<Guarded<K>> states(1, Guarded<K>(mechanism));
    states[0].run_for(10);
    const auto add = [&](bool SafetyRequests::* button, int cycles) {
      states.push_back(states.back());
      if (button) states.back().press(button);
      states.back().run_for(cycles);
    };
    add(&SafetyRequests::acknowledge, 2);  // ready
    add(&SafetyRequests::start, 3);        // torque rises, brakes hold
    add(nullptr, 12);                      // brakes open
    add(nullptr, 60);                      // the law acts
    const Guarded<K> runs = states.back();
    add(&SafetyRequests::stop, 5);  // stops on its path
    add(nullptr, 160);              // brakes close
    add(nullptr, runs.rest());      // stopped
    states.push_back(runs);
    CHECK(states.back().until_stop(1, [](SafetyCycle& cycle, int) { cycle.lost = true; }) == 1);
    add(nullptr, runs.rest());  // fault
    std::uint32_t seen = 0;
    for (const Guarded<K>& state : states) {
      seen |= 1U << static_cast<int>(state.shell.machine.state);
      for (int reading = -1; reading <= n; ++reading)  // none, each motor's, all
        for (int kind = 0; kind < 5; ++kind)
          for (int requests = 0; requests < 8; ++requests) {
            Guarded<K> copy = state;
            const bool fault = copy.shell.machine.state == SafetyState::fault;
            bool acknowledged = false;
            for (int k = 0; k < 40; ++k) {
              SafetyCycle cycle = copy.healthy();
              for (int i = 0; i < n; ++i) {
                if (i != reading && reading != n) continue;
                if (kind == 1) cycle.q[i] += 3;
                if (kind == 2) cycle.q[i] = NAN;
                if (kind == 3) cycle.suspected |= bit(i);
                if (kind == 3) cycle.error[i] = -1.1 * copy.limits.tracking[i];
              }
              cycle.disagree = kind == 4 && reading == n;  // of sensors: no motor is suspected
              const bool now = k == 5 || k == 20;
              cycle.request = {now && requests & 1, k >= 5 && requests & 2, now && requests & 4};
              copy.step(cycle);
              acknowledged = acknowledged || cycle.request.acknowledge;
              if (fault && !acknowledged) CHECK(copy.shell.machine.state == SafetyState::fault);
              const bool bad = reading >= 0 && kind > 0;
              if (bad && kind < 4 && k > 10) CHECK(!copy.shell.follows);
              if (cycle.disagree) CHECK(!copy.shell.follows || copy.shell.path_stop > 0);
            }
          }
    }
    CHECK(seen == 0x1f);
  });
}

TEST("hostile cycles of any numbers, clocks and requests break no promise") {
  for_some_guarded([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Guarded<K> scene(mechanism);
    std::mt19937_64 random(11);
    constexpr double kBad[]{NAN, INFINITY, -INFINITY, 1e308, -1e300, 1e9, 0, 1e-320};
    SafetyCycle cycle = scene.healthy();
    const long count = check::sample_size(kHostile / 5);
    std::array<long, 5> in{};
    long follows = 0;
    for (long k = 0; k < count; ++k) {
      const std::uint64_t bits = random();
      const bool calm = (k >> 8) % 3 != 0;  // else it would hardly ever run
      ++cycle.counter.value;
      cycle.time.value += 1'000'000;
      cycle.request = {(bits & 15) == 0, false, (bits >> 4 & 15) == 0};
      if ((bits >> 8 & 31) == 0 && k % 16 == 0) cycle = scene.healthy();
      if (!calm && (bits >> 13 & 7) == 0) {
        const double bad = bits >> 16 & 1
                               ? kBad[bits >> 17 & 7]
                               : static_cast<double>(static_cast<std::int64_t>(random())) /
                                     static_cast<double>(1ULL << (bits >> 20 & 63));
        Joint* const joints[]{&cycle.q, &cycle.q_d, &cycle.torque, &cycle.load, &cycle.error};
        const int which = static_cast<int>(bits >> 32 & 7), i = static_cast<int>((bits >> 35) % n);
        if (which < 5) (*joints[which])[static_cast<std::size_t>(i)] = bad;
        if (which == 5) cycle.x[static_cast<std::size_t>(i)] = bad;
        if (which == 6) cycle.counter.value += bits >> 40 & 7 ? bits >> 61 : bits;
        if (which == 7) cycle.time.value -= bits >> 40 & 7 ? 0 : bits;
        cycle.answer.status = bits >> 44 & 3 ? Status::ok : Status::singular;
        cycle.suspected = static_cast<std::uint32_t>(bits >> 50 & 63);
        cycle.unused = static_cast<std::uint32_t>(bits >> 46 & 3);
        cycle.lost = (bits >> 56 & 15) == 0;
        cycle.disagree = (bits >> 57 & 15) == 0;
        cycle.known = (bits >> 58 & 15) != 0;
        cycle.counter.given = (bits >> 45 & 7) != 0;
        cycle.request.stop = (bits >> 59 & 15) == 0;
      }
      scene.step(cycle);
      ++in[static_cast<std::size_t>(scene.shell.machine.state)];
      follows += scene.shell.follows;
      for (int i = 0; i < n; ++i) CHECK(std::isfinite(scene.shell.torque[i]));
    }
    for (const long times : in) CHECK(times > 20);
    CHECK(follows > count / 100);
  });
}
