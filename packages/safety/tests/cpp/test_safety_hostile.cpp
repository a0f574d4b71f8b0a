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

TEST_EACH(for_some_guarded, "hostile cycles of any numbers, clocks and requests break no promise") {
  Guarded scene(mechanism);
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
      const double bad = bits >> 16 & 1 ? kBad[bits >> 17 & 7]
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
}
