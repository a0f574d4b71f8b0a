// What does the ideal level leave out, and how large may it be?
#pragma once

#include "truepose/full_linearise.hpp"

namespace truepose {

/// The ideal model that knows its limits. Axes that are not as drawn tilt a real nacelle and turn
/// its bars; to first order the readings then differ from the ideal ones by D η with D = H_ξ(full)
/// - H_ξ(ideal) and η those axis errors. D follows H_ξ in memory: its columns are parameters of
/// their own, about which nobody wants to know, but which readings and estimates must not be blamed
/// for.
struct GuardedModel {
  template <Mobility K>
  static Outcome linearise(const Robot& robot, const Pose& pose, Extended& q_e,
                           Matrix<kMaxReadings, kDof<K>>& H_x, double* H_xi) {
    if (!H_xi) return truepose::linearise<K>(robot, pose, q_e, H_x, nullptr);
    const int size = (kDof<K> + robot.r) * parameter_count(robot);
    double* D = H_xi + size;
    Outcome outcome = linearise_full<K>(robot, pose, q_e, H_x, D);
    if (outcome) outcome = truepose::linearise<K>(robot, pose, q_e, H_x, H_xi);
    if (outcome)
      for (int k = 0; k < size; ++k) D[k] -= H_xi[k];
    return outcome;
  }
  template <Mobility K>
  static Status fkm(const Robot& robot, const Joint& q, Pose& pose) {
    return truepose::fkm<K>(robot, q, pose).status;
  }
};

}  // namespace truepose
