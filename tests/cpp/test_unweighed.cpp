// A build without the laws that weigh. Compiled with TRUEPOSE_UNWEIGHED.
#include "mechanisms.hpp"
#include "truepose/core.hpp"

using namespace truepose;

TEST("without the laws that weigh these are refused by name, and the others work") {
  const Robot robot = mechanisms::h4().robot;
  mechanisms::Prior prior(robot);
  Extended q_e;
  CHECK(extended<Mobility::schoenflies>(robot, to_pose<Mobility::schoenflies>(robot.home), q_e));
  for (const Law law : mechanisms::kLaws) {
    const Status status = properties(law).weighs ? Status::not_compiled : Status::ok;
    ControlSettings settings;
    settings.law = law;
    ControlState state;
    CHECK(control(robot, settings, {robot.home}, q_e, state, prior.weighing()).status == status);
    Joint e{};
    CHECK(motor_error(robot, law, robot.home, q_e, e, 0, prior.weighing()).status == status);
  }
  Robot two = robot;  // the Cartesian law's closed form takes theta's sensor alone
  two.r = 2;
  Joint e{};
  CHECK(motor_error(two, Law::cartesian, robot.home, q_e, e).status == Status::not_compiled);
}
