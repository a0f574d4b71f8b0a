// Inverse and forward kinematics of the H4.
#include <cstdio>

#include "h4.h"  // truepose export c h4 -o h4.h
#include "truepose/truepose.hpp"

namespace {

template <class Values>
void print(const char* name, const Values& values, int count) {
  std::printf("%s", name);
  for (int i = 0; i < count; ++i) std::printf(" %.17g", values[i]);
  std::printf("\n");
}

int failed(const char* task, truepose::Outcome outcome) {
  std::fprintf(stderr, "%s: %s (chain %d)\n", task, describe(outcome.status), outcome.chain + 1);
  return 1;
}

}  // namespace

int main() {
  truepose::Model robot;  // no heap: all memory is the program's own
  if (const auto outcome = robot.load(h4); !outcome) return failed("h4", outcome);
  const int n = robot.freedoms();

  const truepose::Coordinates x{0.05, -0.02, -0.42, 0.3};  // m, rad
  truepose::Joint q;                                       // motor positions at that pose
  if (const auto outcome = robot.ikm(x, q); !outcome) return failed("IKM", outcome);
  truepose::Extended q_e;  // all readings: q, then the redundant sensors', here θ itself
  if (const auto outcome = robot.readings(x, q_e); !outcome) return failed("readings", outcome);
  std::array<truepose::Joint, TRUEPOSE_FREEDOMS> J;  // dx = J dq
  if (const auto outcome = robot.jacobian(x, J); !outcome) return failed("J", outcome);
  truepose::Coordinates found{0, 0, -0.4, 0};  // in: a guess; out: the pose
  if (const auto outcome = robot.fkm(q, found); !outcome) return failed("FKM", outcome);

  print("q", q, n);
  print("q_e", q_e, n + robot.sensors());
  print("x", found, n);
  for (int i = 0; i < n; ++i) print("J", J[i], n);

  // Nothing throws: the status of an impossible pose names the chain.
  const auto beyond = robot.ikm(truepose::Coordinates{0, 0, -2, 0}, q);
  std::printf("2 m below: %s, chain %d\n", describe(beyond.status), beyond.chain + 1);
  return 0;
}
