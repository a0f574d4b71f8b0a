// A build for one mobility at the ideal level. Compiled with
// TRUEPOSE_ONLY_MOBILITY=schoenflies and TRUEPOSE_IDEAL_ONLY.
#include "mechanisms.hpp"
#include "truepose/core.hpp"

using namespace truepose;

TEST("a build for Schoenflies robots compiles no other mobility") {
  long called = 0;
  for (int k = 0; k < kMobilities; ++k)
    with_mobility(static_cast<Mobility>(k), [&](auto mobility) {
      static_assert(mobility() == Mobility::schoenflies);
      ++called;
    });
  CHECK(called == kMobilities);
}

TEST("it refuses robots of every other mobility, and answers for its own") {
  for (int k = 0; k < kMobilities; ++k) {
    Robot robot = mechanisms::h4().robot;
    robot.mobility = static_cast<Mobility>(k);
    robot.chains = robot.motors = dof(robot.mobility);
    const bool own = robot.mobility == Mobility::schoenflies;
    CHECK(finish(robot).status == (own ? Status::ok : Status::not_compiled));
    CHECK(robot.finished == own);
    Coordinates x = robot.home;
    Joint q{};
    CHECK(ikm(robot, x, q).status == (own ? Status::ok : Status::unfinished));
    CHECK(fkm(robot, q, x).status == (own ? Status::ok : Status::unfinished));
  }
}

TEST("a robot that asks for the full level is refused, not understood as an ideal one") {
  Robot robot = mechanisms::h4().robot;
  CHECK(finish_full(robot).status == Status::not_compiled);
  Coordinates x = robot.home;
  Joint q{};
  CHECK(ikm_full(robot, x, q).status == Status::no_full_level);
  robot.level = Level::full;
  CHECK(finish(robot).status == Status::not_compiled);
  Setpoint setpoint{robot.home};
  ControlState state;
  CHECK(control(robot, {}, setpoint, {}, state).status == Status::unfinished);
}

TEST("every law and the learner still work") {
  const Robot robot = mechanisms::h4().robot;
  mechanisms::Prior prior(robot);
  for (const Law law : mechanisms::kLaws) {
    ControlSettings settings;
    settings.law = law;
    if (!place_poles(robot, robot.home, 150, 1, settings)) CHECK(false);
    Extended q_e;
    CHECK(extended<Mobility::schoenflies>(robot, to_pose<Mobility::schoenflies>(robot.home), q_e));
    ControlState state;
    CHECK(control(robot, settings, {robot.home}, q_e, state, prior.weighing()));
    OnlineCalibrator learner = prior.learner(robot);
    CHECK(calibrate_online<Mobility::schoenflies>(learner, q_e));
  }
}
