// Fuzz target of the full level.
#include "decode.hpp"
#include "mechanism/levels.hpp"

using namespace fuzz;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  const Subject subject = decode_robot(bytes);
  const Robot& robot = subject.robot;
  const int n = dof(robot.mobility), m = robot.motors;
  const Coordinates x = decode_pose(bytes, subject);
  const Joint q = decode_motors(bytes, subject);
  Coordinates found = decode_pose(bytes, subject);
  Joint motors{};
  Coordinates rest{};
  const bool reached = static_cast<bool>(ikm(Level::full, robot, x, motors));
  if (reached) require(all_finite(motors, m), "full ikm: ok is finite");
  if (parasitic(robot, x, rest)) require(all_finite(rest, kMaxDof), "parasitic: ok is finite");
  JointMatrix J;
  if (jacobian(Level::full, robot, x, J)) require(finite(J, n, m), "full jacobian: ok is finite");
  Extended q_e;
  if (extended(Level::full, robot, to_pose(robot.mobility, x), q_e))
    require(all_finite(q_e, readings(robot)), "full readings: ok is finite");
  const FkmResult result = fkm(Level::full, robot, q, found);
  require(result.iterations <= 2 * kFkmIterations, "full fkm: iterations are bounded");
  if (!result) return 0;
  require(all_finite(found, n), "full fkm: ok is finite");
  const double longest = 1 + *std::max_element(q.begin(), q.end());  // of a telescopic leg
  const double open = overdriven(robot) ? kDisagreement : 1e-11;     // of a rod's length
  if (subject.buildable) require(result.residual < open * longest, "full fkm: ok is closed");
  return 0;
}
