// The exact plant: its effects and its initial state.
#include "mechanisms.hpp"
#include "simulation/effects.hpp"

using namespace mechanisms;

namespace {

constexpr Mobility K = Mobility::schoenflies;

/// An H4 whose θ is read behind a gear.
Mechanism geared() {
  Mechanism mechanism = h4();
  mechanism.robot.sensor[0].eccentricity.gear = 4;
  return mechanism;
}

}  // namespace

TEST("a gear follows half its play behind, on either side, and a direct encoder at once") {
  for (const double gear : {4.0, 1.0}) {
    Mechanism mechanism = geared();
    mechanism.robot.sensor[0].eccentricity.gear = gear;
    mechanism.robot.gravity = Vec3::Zero();
    Effects effects;
    effects.backlash = 0.01;
    Plant plant(mechanism.robot, effects, to_pose(K, mechanism.robot.home), 0);
    CHECK(plant.rest());
    Extended read{};
    CHECK(plant.measure(read));
    // Turned one way, then back: motors 1, 2 against 3, 4 turn this nacelle.
    double most = 0, least = 0;
    for (const double side : {1.0, -1.0, -1.0, -1.0}) {
      for (int k = 0; k < 40; ++k) {
        CHECK(plant.advance({side, -side, side, -side}, 1e-3, 2));
        CHECK(plant.measure(read));
        const double behind = read[4] - plant.pose().theta;
        most = std::max(most, behind), least = std::min(least, behind);
      }
    }
    const double half = gear == 1 ? 0 : effects.backlash / 2;
    CHECK_NEAR(most, half, 1e-12);
    CHECK_NEAR(least, -half, 1e-12);
  }
}

TEST(
    "Dahl's friction loses its initial state over some lengths of presliding and remembers at "
    "rest") {
  CHECK_NEAR(dahl(0.3, 0, 1e-4), 0.3, 1e-15);
  CHECK_NEAR(dahl(-1, 1e-2, 1e-4), 1, 1e-12);
  CHECK_NEAR(dahl(1, -1e-2, 1e-4), -1, 1e-12);
  // Two steps one way are one: it depends on the way alone.
  CHECK_NEAR(dahl(dahl(-0.5, 3e-5, 1e-4), 4e-5, 1e-4), dahl(-0.5, 7e-5, 1e-4), 1e-15);
  CHECK_NEAR(dahl(0, 1e-4, 1e-4), 1 - std::exp(-1), 1e-15);
}
