// Inverse and forward kinematics of the H4.
#include <cstdio>

#include "h4.hpp"

namespace {

template <class Values>
void print(const char* name, const Values& values, int count) {
  std::printf("%s", name);
  for (int i = 0; i < count; ++i) std::printf(" %.17g", values[i]);
  std::printf("\n");
}

int failed(const char* what, truepose::Outcome outcome) {
  std::fprintf(stderr, "%s: %s (chain %d)\n", what, describe(outcome.status), outcome.chain + 1);
  return 1;
}

}  // namespace

int main() {
  truepose::Robot robot;
  if (const auto made = make_h4(robot); !made) return failed("the robot", made);

  const truepose::Coordinates x{0.05, -0.02, -0.42, 0.3};  // m, rad
  truepose::Joint q;                                       // motor positions that hold the pose
  if (const auto outcome = ikm(robot, x, q); !outcome) return failed("IKM", outcome);
  truepose::Reading r;  // what the redundant sensors read there: here θ itself
  if (const auto outcome = rkm(robot, x, r); !outcome) return failed("RKM", outcome);
  truepose::JointMatrix J;  // dx = J dq
  if (const auto outcome = jacobian(robot, x, J); !outcome) return failed("J", outcome);
  truepose::Coordinates back = robot.home;  // in: a guess; out: the pose
  if (const auto found = fkm(robot, q, back); !found)
    return failed("FKM", {found.status, found.chain});

  print("q", q, 4);
  print("r", r, robot.r);
  print("x", back, 4);
  for (int i = 0; i < 4; ++i) print("J", J[i], 4);

  // Nothing throws: a pose out of reach is an answer, too, and names the chain.
  const auto beyond = ikm(robot, {0, 0, -2, 0}, q);
  std::printf("2 m below: %s, chain %d\n", describe(beyond.status), beyond.chain + 1);
  return 0;
}
