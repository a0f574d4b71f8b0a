// The safety shell around laws of simulated robots: what trips it, how soon, and how it stops.
#include "safety_bench.hpp"

using namespace mechanisms;

namespace {

/// Robots of three kinds of motors and up to six freedoms.
template <class F>
void for_some(F&& f) {
  for_each([&](const Mechanism& mechanism, auto mobility) {
    const std::string name = mechanism.name;
    if (name == "H4" || name == "Delta" || name == "6-UPS" || name == "5-bar")
      f(mechanism, mobility);
  });
}

/// Cycles of at most 10 ms.
constexpr int kSoon = 10;

}  // namespace

TEST("healthy robots with counts never trip, under every law, in moves of 0.2 s") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    for (const Law law : {Law::joint, Law::tej, Law::cartesian, Law::estimated}) {
      if (law == Law::cartesian && kDof<mobility()> == 6) continue;
      Bench<mobility()> bench(mechanism, law);
      bench.begin();
      check::Random random(5);
      for (int m = 0; m < 3; ++m) {
        bench.move(random_pose(mechanism, random, 0.5), 0.2);
        bench.run_for(240);
        CHECK(bench.healthy());
        if (!bench.healthy()) std::printf("%s\n", properties(bench.shell.cause).name);
      }
    }
  });
}
